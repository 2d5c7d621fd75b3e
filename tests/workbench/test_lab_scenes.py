"""The nine scenes of the robust lab without a browser: every extreme, code that gives the numbers,
and the lesson.
"""

import contextlib
import gc
import io
import re
import time
import warnings
import weakref

import cv2
import numpy as np
import pytest
from ipywidgets.widgets.widget import _instances

from losbench.workbench.explorers import lab
from losbench.workbench.explorers.controls import Choice, LogSlider, Slider

SCENES = [thing for thing in vars(lab).values() if isinstance(thing, type)]


@pytest.fixture(params=SCENES, ids=lambda kind: kind.__name__, scope="module")
def kind(request):
    return request.param


def test_there_are_nine_scenes():
    assert len(SCENES) == 9


@pytest.fixture(scope="module")
def made(kind):
    with contextlib.closing(kind()) as scene:
        yield scene


@pytest.fixture
def scene(made):
    made.reset()
    return made


def pixels(scene):
    return cv2.imdecode(np.frombuffer(scene.view.png, np.uint8), cv2.IMREAD_COLOR)


def extremes(control):
    if isinstance(control, Slider | LogSlider):
        return [control.low, control.high]
    return list(control.options.values()) if isinstance(control, Choice) else []


def assert_well(scene):
    assert scene.message.value == ""
    wide, high = scene.size_in
    assert pixels(scene).shape == (round(100 * high), round(100 * wide), 3)
    assert pixels(scene).std() > 5
    assert "nan" not in scene.numbers.value


def shown(scene):
    """Numbers beside the picture, by label."""
    cells = re.findall(r"<small>(.*?)</small><br>(.*?)</div>", scene.numbers.value)
    return {label.replace("&gt;", ">"): text for label, text in cells}


def put(scene, **settings):
    scene._put({name: scene.controls[name].held(value) for name, value in settings.items()})
    return shown(scene)


def test_every_extreme_and_every_preset_gives_a_picture(scene):
    for name, control in scene.controls.items():
        for value in extremes(control):
            put(scene, **{name: value})
            assert control.stated(value) in scene.stated
            assert_well(scene)
        scene.reset()
    for preset in scene.presets.values():
        put(scene, **preset)
        assert_well(scene)
        scene.reset()


def test_corners_of_all_controls_at_once_give_a_picture(scene):
    rng = np.random.default_rng(3)
    ranges = {
        name: extremes(control) for name, control in scene.controls.items() if extremes(control)
    }
    for pick in (
        [0] * len(ranges),
        [-1] * len(ranges),
        *rng.integers(0, 2, (5, len(ranges))).tolist(),
    ):
        put(
            scene,
            **{name: values[k] for k, (name, values) in zip(pick, ranges.items(), strict=True)},
        )
        assert_well(scene)


def test_a_picture_that_was_moved_is_the_one_drawn_from_scratch(kind, scene):
    first = scene.view.png
    preset = next(iter(scene.presets.values()))
    put(scene, **preset)
    with contextlib.closing(kind(**preset)) as fresh:
        assert np.array_equal(pixels(fresh), pixels(scene))
        assert fresh.numbers.value == scene.numbers.value
    scene.reset()
    assert scene.view.png == first


def test_presets_do_not_pile_up(scene):
    first = scene.settings
    for name, values in scene.presets.items():
        scene.preset(name)
        assert scene.settings == first | values


def test_a_step_takes_a_tenth_of_a_second(scene):
    """Room for a browser within the 0.3 s of a slider; the shortest of a few, for busy machines."""
    name, control = next((n, c) for n, c in scene.controls.items() if isinstance(c, Slider))
    took = []
    for value in (control.low, control.high, control.value, control.low, control.value):
        begin = time.process_time()
        put(scene, **{name: value})
        took.append(time.process_time() - begin)
    assert min(took) < 0.15


def test_another_seed_is_another_picture(scene):
    if "seed" in scene.controls:
        first = scene.view.png
        scene.new_noise()
        assert scene.view.png != first
        assert "seed 1" in scene.stated


def test_closing_leaves_nothing_behind(kind, only_new_rubbish):
    before = set(_instances)
    scene = kind()
    figure = weakref.ref(scene._picture._figure)
    scene.close()
    assert set(_instances) == before
    for _ in range(2):
        gc.collect()
    assert figure() is None


NUMBERS = {
    "DragPoint": ["slope, least squares", "slope, Huber", "slope, MM"],
    "LossShapes": ["efficiency on normal errors", "most that one bad value can do"],
    "BreakdownMeter": [None, None, None, "slope now, MM"],
    "ScaleIsTheHero": None,
    "YourLayout": ["bad spots survived by Huber", "… by LTS or MM, as by any estimate"],
    "Leverage": ["leverage", "slope, Huber", "slope, MM"],
    "Masking": None,
    "Basins": ["ends at"],
    "MMActs": ["slope", "scale, frozen since act 1"],
}
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]\d+)?")


def test_the_code_runs_and_gives_the_numbers_shown(kind, scene):
    for preset in ({}, *scene.presets.values()):
        scene.reset()
        numbers = put(scene, **preset)
        assert scene.view.code == scene.code(**scene.settings)
        with contextlib.redirect_stdout(io.StringIO()) as printed, warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".*did not converge")
            exec(compile(scene.view.code, "<copied>", "exec"), {})
        text = printed.getvalue()
        if kind is lab.Masking:
            single, robust = (re.findall(r"\d+", part) for part in re.findall(r"\[(.*?)\]", text))
            for name, rows in (("one by one", single), ("against MM", robust)):
                bad, accused = (
                    numbers[f"{what}, {name}"] for what in ("bad ones found", "good ones accused")
                )
                assert len(rows) == int(bad.split()[0]) + int(accused)
        elif kind is lab.ScaleIsTheHero:
            values = [float(value) for value in NUMBER.findall(text)]
            for k, name in enumerate(("std", "MAD", "known")):
                weight, error = values[2 * k : 2 * k + 2]
                assert numbers[f"{name}: weight · error"] == f"{weight:.4f} · {error:.3f}"
        else:
            values = [float(value) for value in NUMBER.findall(text)]
            for value, label in zip(values, NUMBERS[kind.__name__], strict=True):
                if label is not None:
                    said = NUMBER.search(numbers[label]).group()
                    decimals = len(said.partition(".")[2])
                    assert value == pytest.approx(float(said), abs=0.6 * 10.0**-decimals)


# What each scene is there to teach


def lesson(kind, **settings):
    with contextlib.closing(kind(**settings)) as scene:
        return shown(scene)


def test_drag_the_line_of_mm_stays():
    far, farther = (lesson(lab.DragPoint, height=height) for height in (15.0, 25.0))
    assert far["slope, MM"] == farther["slope, MM"]
    assert far["its weight, MM"] == "0.000"
    assert float(farther["slope, least squares"]) > float(far["slope, least squares"]) + 0.2


def test_shapes_95_percent_at_one():
    for loss in ("Huber", "Bisquare", "Cauchy", "Welsch", "Hampel"):
        assert lesson(lab.LossShapes, loss=loss)["efficiency on normal errors"] == "95.00 %"


def test_shapes_the_picture_names_its_loss():
    with contextlib.closing(lab.LossShapes()) as scene:
        for loss in ("Bisquare", "Hampel"):
            put(scene, loss=loss, factor=1.2)
            assert scene._name.get_text() == f"{loss}, {shown(scene)['constant']}"


def test_breakdown_mm_survives_nine_of_twenty():
    numbers = lesson(lab.BreakdownMeter, off=100.0)
    assert numbers["least squares survives"] == "0 of 20"
    assert numbers["LTS survives"] == numbers["MM survives"] == "9 of 20"
    assert 0 < int(numbers["Huber survives"].split()[0]) < 9


def test_scale_a_standard_deviation_never_lets_go():
    numbers = {
        name: value.split(" · ") for name, value in lesson(lab.ScaleIsTheHero, off=1000.0).items()
    }
    assert float(numbers["std: weight · error"][0]) > 0.3
    assert float(numbers["MAD: weight · error"][0]) < 0.01
    assert float(numbers["MAD: weight · error"][1]) < 1.0


def test_layout_a_ring_of_eight():
    numbers = lesson(lab.YourLayout)
    assert numbers["bad spots survived by Huber"] == "2"
    assert numbers["… by LTS or MM, as by any estimate"] == "3"


def test_leverage_huber_follows_mm_does_not():
    numbers = lesson(lab.Leverage, place=60.0)
    assert float(numbers["leverage"]) > 0.9
    assert abs(float(numbers["slope, Huber"])) < 0.1
    assert float(numbers["slope, MM"]) == pytest.approx(0.5, abs=0.1)


def test_masking_one_is_found_and_three_hide():
    assert lesson(lab.Masking, bad=1)["bad ones found, one by one"] == "1 of 1"
    numbers = lesson(lab.Masking, bad=3)
    assert numbers["bad ones found, one by one"] == "0 of 3"
    assert numbers["bad ones found, against MM"] == "3 of 3"


def test_basins_two_for_a_redescender_one_for_huber():
    assert len(lesson(lab.Basins)["different ends"].split(" · ")) == 2
    assert len(lesson(lab.Basins, loss="Huber")["different ends"].split(" · ")) == 1
    assert float(lesson(lab.Basins, start=8.0)["ends at"]) > 7.0


def test_acts_the_last_keeps_the_scale_and_gains_precision():
    first, last = lesson(lab.MMActs, act=1), lesson(lab.MMActs, act=3)
    assert first["scale, frozen since act 1"] == last["scale, frozen since act 1"]
    error = [float(text["slope"].split("± ")[1]) for text in (first, last)]
    assert error[1] < error[0]
    weight = [
        float(NUMBER.search(text["weight of all good points"]).group()) for text in (first, last)
    ]
    assert weight[1] > weight[0] + 0.05


def test_acts_bad_points_stay_in_sight_however_bad():
    with contextlib.closing(lab.MMActs(level=20.0, bad=10)) as scene:
        for marks in (scene._bad, scene._bad_weights):
            for values, (low, high) in zip(
                marks.get_data(), (marks.axes.get_xlim(), marks.axes.get_ylim()), strict=True
            ):
                assert len(values) == 10
                assert all(low < value < high for value in values)
