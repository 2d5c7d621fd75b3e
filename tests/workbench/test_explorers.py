"""Explorers without a browser: every extreme, every message, and the same picture however one gets
there.
"""

import contextlib
import gc
import inspect
import io
import itertools
import re
import sys
import warnings
import weakref
from functools import cache

import cv2
import matplotlib as mpl
import numpy as np
import pytest
from ipywidgets import interactive
from ipywidgets.widgets.widget import _instances
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath
from PIL import Image

import losbench as lb
from losbench.workbench.explorers import (
    CentroidExplorer,
    ChainExplorer,
    IdentifyExplorer,
    InertialExplorer,
    IRLSExplorer,
    MonteCarloExplorer,
    StarCameraExplorer,
    ThermalExplorer,
    ThermoelasticExplorer,
    base,
    lab,
)
from losbench.workbench.explorers import irls as irls_room
from losbench.workbench.explorers.centroid import light_with_a_spot_at
from losbench.workbench.explorers.controls import (
    Choice,
    Field,
    LogSlider,
    Slider,
    moved_spots,
    numbers,
    whole_number,
)
from losbench.workbench.explorers.picture import Picture, style

EXPLORERS = [
    CentroidExplorer,
    ChainExplorer,
    IdentifyExplorer,
    InertialExplorer,
    IRLSExplorer,
    MonteCarloExplorer,
    StarCameraExplorer,
    ThermalExplorer,
    ThermoelasticExplorer,
]
SCENES = [thing for thing in vars(lab).values() if isinstance(thing, type)]
ALL = [*EXPLORERS, *SCENES]
DEJAVU = FontProperties(family="DejaVu Sans")
EXPECTED_NOTES = (
    "with two spots per solve no outlier can be identified",
    "attitudes did not converge; their last iterate is kept",
    "axes did not converge, see .converged",
)


NONSENSE = ["", "abc", "1e", "-1", "0.5", "nan", "inf", "1, 2", "<b>7</b>"]


@pytest.fixture(params=EXPLORERS, ids=lambda kind: kind.__name__, scope="module")
def kind(request):
    return request.param


@pytest.fixture(scope="module")
def made(kind):
    with contextlib.closing(kind()) as explorer:
        yield explorer


@pytest.fixture
def explorer(made):
    made.reset()
    return made


def pixels(explorer):
    return cv2.imdecode(np.frombuffer(explorer.view.png, np.uint8), cv2.IMREAD_COLOR)


def described(explorer):
    """What the picture itself says that it shows."""
    text = Image.open(io.BytesIO(explorer.view.png)).text["Description"]
    assert text == explorer.stated
    return text


def assert_well(explorer):
    """The picture has its size and something in it, and no note but those that belong to robust
    fits.
    """
    notes = explorer.message.value.replace("</div>", "\n").splitlines()
    assert all(any(expected in note for expected in EXPECTED_NOTES) for note in notes), notes
    picture = pixels(explorer)
    wide, high = explorer.size_in
    assert picture.shape == (round(100 * high), round(100 * wide), 3)
    assert picture.std() > 5
    assert explorer.numbers.value


def extremes(control):
    if isinstance(control, Slider | LogSlider):
        return [control.low, control.high]
    return list(control.options.values()) if isinstance(control, Choice) else []


def defaults(kind):
    return {name: control.value for name, control in kind.controls.items()}


def put(explorer, **settings):
    explorer._put({name: explorer.controls[name].held(value) for name, value in settings.items()})


def test_every_extreme_of_every_control_gives_a_picture(explorer):
    for name, control in explorer.controls.items():
        for value in extremes(control):
            put(explorer, **{name: value})
            assert explorer.settings[name] == value
            assert control.stated(value) in described(explorer)
            assert_well(explorer)
        explorer.reset()


def test_corners_of_all_controls_at_once_give_a_picture(explorer):
    rng = np.random.default_rng(3)
    ranges = {
        name: extremes(control) for name, control in explorer.controls.items() if extremes(control)
    }
    for pick in (
        [0] * len(ranges),
        [-1] * len(ranges),
        *rng.integers(0, 2, (8, len(ranges))).tolist(),
    ):
        put(
            explorer,
            **{name: values[k] for k, (name, values) in zip(pick, ranges.items(), strict=True)},
        )
        assert_well(explorer)


def test_a_picture_that_was_moved_is_the_one_drawn_from_scratch(kind, explorer):
    first = explorer.view.png
    for name, preset in explorer.presets.items():
        explorer.preset(name)
        with contextlib.closing(kind(**preset)) as fresh:
            assert np.array_equal(pixels(fresh), pixels(explorer))
            assert fresh.numbers.value == explorer.numbers.value
    explorer.reset()
    assert explorer.view.png == first


def test_axes_drawn_one_by_one_are_the_figure_drawn_at_once():
    rng = np.random.default_rng(8)
    figure = Figure(figsize=(7.0, 3.0), dpi=100)
    figure.suptitle("beside the axes")
    panels = figure.subplots(1, 3)
    (line,) = panels[0].plot([0.0, 1.0], [0.0, 1.0])
    for axes in panels:
        axes.plot(rng.normal(size=50), label="stands still")
        axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.2))
    picture = Picture(figure, [line])
    for top in [5.0, *rng.permutation(np.geomspace(1.0, 1e3, 15)), 5.0]:
        panels[0].set_ylim(-top, top)
        panels[2].set_xlim(0.0, top)
        shown = cv2.imdecode(np.frombuffer(picture.png(""), np.uint8), cv2.IMREAD_COLOR)
        canvas = figure.canvas
        with mpl.rc_context(style()):
            canvas.draw()
        figure.draw_artist(line)
        assert np.array_equal(shown, np.asarray(canvas.buffer_rgba())[..., 2::-1])


def test_new_noise_is_another_picture_and_reset_the_first(explorer):
    first = explorer.view.png
    explorer.new_noise()
    assert explorer.view.png != first
    assert f"seed {explorer.settings['seed']}" in explorer.stated
    explorer.reset()
    assert explorer.view.png == first


def test_a_preset_is_the_same_whatever_came_before(kind):
    name, control = next(
        (n, c) for n, c in kind.controls.items() if isinstance(c, Slider | LogSlider)
    )
    with contextlib.closing(kind(**{name: control.low})) as explorer:
        for preset, values in kind.presets.items():
            explorer.new_noise()
            before = set(_instances)
            explorer.preset(preset)
            assert set(_instances) == before
            expected = (
                {each: control.value for each, control in kind.controls.items()}
                | {name: control.low}
                | values
            )
            assert explorer.settings == expected


RESULT = {
    CentroidExplorer: lambda n: (
        n["seen"]["found"].xy[0, 0] - n["_TRUTH"],
        ".2f",
        "error of this frame",
    ),
    ChainExplorer: lambda n: (
        n["seen"]["errors_arcsec"]["Huber"],
        "+.3f",
        "error X · Y · Z (″), Huber",
    ),
    InertialExplorer: lambda n: (
        [
            np.linalg.norm(
                n["seen"]["found"]["iterative, above 2 %"].xy[0, 0] - n["seen"]["star"].end[0]
            )
        ],
        ".4f",
        "error, iterative, above 2 %",
    ),
    IRLSExplorer: lambda n: (
        np.sqrt(np.mean(n["seen"]["IRLS"].angles_arcsec ** 2, axis=0)),
        ".3g",
        "IRLS: RMS error",
    ),
    IdentifyExplorer: lambda n: (
        [n["seen"]["error_arcsec"]],
        ".3f",
        "error of folds left out",
    ),
    MonteCarloExplorer: lambda n: (n["seen"].sigma_arcsec[0], ".3g", "RMS"),
    StarCameraExplorer: lambda n: (
        [n["seen"]["unbiased"].lsfe, n["seen"]["unbiased"].nea],
        ".3f",
        "LSFE · NEA unbiased, raw",
    ),
    ThermalExplorer: lambda n: (
        n["seen"]["fits"]["IRLS"].k_arcsec_per_degC,
        ".3f",
        "sensitivity, IRLS",
    ),
    ThermoelasticExplorer: lambda n: (
        n["seen"]["angles_arcsec"],
        ".3f",
        "line of sight at the end",
    ),
}


def run_copied(explorer):
    """Run the code that an explorer shows; return its names and what it prints."""
    names = {}
    with contextlib.redirect_stdout(io.StringIO()) as printed, warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*two spots per solve|.*did not converge")
        exec(compile(explorer.view.code, "<copied>", "exec"), names)
    return names, printed.getvalue()


def assert_its_code_gives_its_numbers(explorer):
    assert explorer.view.code == explorer.code(**explorer.settings)
    names, printed = run_copied(explorer)
    assert printed.strip()
    values, form, label = RESULT[type(explorer)](names)
    unit = 1e3 if isinstance(explorer, CentroidExplorer) else 1.0
    shown = " · ".join(f"{unit * value:{form}}" for value in values)
    assert label in explorer.numbers.value
    assert shown in explorer.numbers.value


def test_the_code_runs_and_gives_the_numbers_shown(explorer):
    assert_its_code_gives_its_numbers(explorer)
    for preset in explorer.presets:
        explorer.preset(preset)
        assert_its_code_gives_its_numbers(explorer)


def test_unseen_years_tell_a_model_from_a_fit_that_only_fits():
    """What is there predicts to the noise; a season for the temperature, and a missing step, not."""
    with contextlib.closing(IdentifyExplorer(noise_arcsec=0.1)) as explorer:
        errors = {}
        for name in ("all that is there", "season for temperature"):
            explorer.preset(name)
            errors[name] = run_copied(explorer)[0]["seen"]["error_arcsec"]
        assert errors["all that is there"] == pytest.approx(0.1, rel=0.2)
        assert errors["season for temperature"] > 0.5
        explorer.preset("all that is there")
        seen = run_copied(explorer)[0]["seen"]
        low, high = seen["fit"].interval[0]
        assert low < 0.6 < high
        assert seen["judged"].baselines["last"] > seen["judged"].sigma
        put(explorer, horizon="forward")
        assert "cannot be predicted" in explorer.numbers.value


def test_two_spots_and_one_frame_say_why_nothing_changes():
    with contextlib.closing(IRLSExplorer()) as explorer:
        explorer.preset("as in the paper")
        assert "no outlier can be identified" in explorer.message.value
        assert (
            float(
                explorer.numbers.value.split("largest difference")[1].split("<br>")[1].split(" ")[0]
            )
            < 1e-9
        )
        put(explorer, n_frames=10)
        assert "no outlier can be identified" not in explorer.message.value


def test_nonsense_in_a_field_is_a_message_and_changes_nothing_else(explorer):
    def shown():
        return (
            explorer.view.png,
            explorer.stated,
            explorer.numbers.value,
            explorer.view.code,
        )

    before = shown()
    fields = {
        name: control for name, control in explorer.controls.items() if isinstance(control, Field)
    }
    for name, control in fields.items():
        for nonsense in NONSENSE:
            explorer.inputs[name].value = nonsense
            assert f"{control.label} must be" in explorer.message.value
            assert "<b>7" not in explorer.message.value
            assert shown() == before
        explorer.reset()
        assert "must be" not in explorer.message.value


def test_new_noise_finds_its_way_out_of_a_bad_seed(explorer):
    explorer.inputs["seed"].value = "abc"
    explorer.new_noise()
    assert explorer.settings["seed"] == 0
    assert_well(explorer)


def test_a_value_error_of_the_library_is_a_message(explorer, monkeypatch):
    def refuse(**settings):
        raise ValueError("spots <must> differ")

    before = explorer.view.png
    monkeypatch.setattr(explorer, "update", refuse)
    explorer.new_noise()
    assert "spots &lt;must&gt; differ" in explorer.message.value
    assert explorer.view.png == before


def test_the_picture_goes_into_exported_pages(explorer):
    import base64

    bundle = explorer._repr_mimebundle_()
    assert base64.b64decode(bundle["image/png"]) == explorer.view.png
    assert "application/vnd.jupyter.widget-view+json" in bundle
    assert bundle["text/plain"] == f"{type(explorer).__name__}()"


def test_closing_leaves_nothing_behind(kind, only_new_rubbish):
    before = set(_instances)
    explorer = kind()
    name, control = next(iter(kind.controls.items()))
    slider = explorer.inputs[name]
    picture, figure = weakref.ref(explorer._picture), weakref.ref(explorer._picture._figure)
    shown = explorer.view.png
    assert len(_instances) > len(before)
    explorer.close()
    slider.value = control.high
    assert explorer.view.png == shown
    explorer.close()
    assert set(_instances) == before
    for _ in range(2):  # figures are freed after the callbacks that know them
        gc.collect()
    assert picture() is None
    assert figure() is None
    gone = weakref.ref(explorer)
    del explorer, slider
    gc.collect()
    assert gone() is None


def test_running_a_cell_again_closes_what_its_earlier_run_made(monkeypatch):
    """By `close`, which the test above asks of every kind."""
    kind, before = MonteCarloExplorer, set(_instances)
    monkeypatch.setattr(base, "_shown", {})
    monkeypatch.setattr(base, "_running_cell", lambda: ("cell", "first run"))
    first, second = kind(), kind()
    assert first.comm is not None
    monkeypatch.setattr(base, "_running_cell", lambda: ("another cell", "another run"))
    other = kind()
    alone = len(_instances)
    for run in range(3):
        monkeypatch.setattr(base, "_running_cell", lambda run=run: ("cell", f"run {run}"))
        third = kind()
    assert first.comm is None
    assert second.comm is None
    assert len(_instances) < alone
    other.close()
    third.close()
    assert set(_instances) == before


def test_settings_to_begin_with(kind):
    name, control = next(
        (n, c) for n, c in kind.controls.items() if isinstance(c, Slider | LogSlider)
    )
    with contextlib.closing(kind(**{name: control.low})) as explorer:
        first = explorer.view.png
        explorer.new_noise()
        explorer.reset()
        assert explorer.settings[name] == control.low
        assert explorer.view.png == first
    with pytest.raises(ValueError, match=f"{kind.__name__} has no nonsense; it has {name}"):
        kind(nonsense=1)
    with pytest.raises(ValueError, match=f"{control.label} must be a finite number from"):
        kind(**{name: control.high * 2 + 1})


def test_the_users_own_figure_style_stays_as_it_was():
    with mpl.rc_context({"lines.linewidth": 7.0, "axes.grid": False}):
        with contextlib.closing(MonteCarloExplorer()) as explorer:
            put(explorer, precision_px=1.0)
            other = explorer.view.png
        assert mpl.rcParams["lines.linewidth"] == 7.0
        assert not mpl.rcParams["axes.grid"]
    with contextlib.closing(MonteCarloExplorer(precision_px=1.0)) as explorer:
        assert explorer.view.png == other


def test_parsers_of_fields():
    assert whole_number("seed", " 12 ") == 12
    assert numbers(2, low=0, high=5)("links", "1; 2.5") == (1.0, 2.5)
    with pytest.raises(ValueError, match="links must be 2 numbers separated by commas, got 3"):
        numbers(2, low=0, high=5)("links", "1, 2, 3")
    with pytest.raises(ValueError, match="links must be a finite number from 0 to 5, got 7"):
        numbers(2, low=0, high=5)("links", "1, 7")
    with pytest.raises(ValueError, match=r"seed must be a whole number, got 1\.5"):
        whole_number("seed", "1.5")


def test_a_choice_never_offers_none_which_a_list_shows_as_nothing():
    with pytest.raises(
        ValueError, match="weight must not offer None, which a list shows as nothing selected"
    ):
        Choice("weight", {"spot": "spot", "coordinate": None}, "spot")
    for control in itertools.chain(*(kind.controls.values() for kind in ALL)):
        for value in control.options.values() if isinstance(control, Choice) else ():
            with contextlib.closing(control.widget(value)) as made:
                assert control.options[made.label] == value


def test_one_weight_for_each_coordinate_is_what_the_library_calls_no_group():
    for group, shared in (("coordinate", False), ("spot", True)):
        with contextlib.closing(IRLSExplorer(group=group)) as explorer:
            assert f"one weight for each {group}" in explorer.stated
            weights = run_copied(explorer)[0]["seen"]["IRLS"].weights
            assert np.array_equal(weights[..., 0], weights[..., 1]) == shared


@pytest.mark.parametrize("kind", ALL, ids=lambda kind: kind.__name__)
def test_copied_code_is_the_source_that_ran(kind):
    text = kind.code(kind, **defaults(kind))
    assert inspect.getsource(kind.experiment).strip() in text
    named = re.findall(r"^(?:from|import) (\S*)", text, re.MULTILINE)
    outside = {name for name in named if name.split(".")[0] not in sys.stdlib_module_names}
    assert outside <= {"numpy", "losbench", "losbench.papers"}
    assert max(map(len, text.splitlines())) <= 100


def test_a_log_slider_shows_its_value_where_nobody_can_type():
    with contextlib.closing(LogSlider("light", 20.0, 1.0, 1000.0, "e").widget(37.3)) as made:
        slider, readout = made.children
        assert not slider.readout
        assert (made.value, readout.value) == (37.3, "37.3")
        slider.index += 1
        assert (made.value, readout.value) == (40.0, "40")
        made.value = 500.0
        assert (slider.value, readout.value) == (500.0, "500")
        assert interactive(lambda light: None, light=made).kwargs_widgets == [made]
        slider.close()
        readout.close()


@cache
def fits(line):
    return TextPath((0, 0), line, size=12, prop=DEJAVU).get_extents().x1 < 124


def test_labels_are_short_enough_for_two_lines():
    """Measured in DejaVu Sans of 12 px, wider than the fonts of most pages; the place is 126 px
    wide.
    """
    for kind in ALL:
        for control in kind.controls.values():
            unit = getattr(control, "unit", "")
            text = f"{control.label} ({unit})" if unit else control.label
            lines = [""]
            for word in text.split():
                longer = f"{lines[-1]} {word}".strip()
                lines[-1:] = [longer] if fits(longer) or not lines[-1] else [lines[-1], word]
            assert len(lines) <= 2, lines
            assert all(map(fits, lines)), lines


def test_a_gradient_never_goes_below_zero():
    far_off = light_with_a_spot_at(
        np.array([-500.0, -500.0]),
        flux_e=1e5,
        background_e=0.0,
        gradient_e=10.0,
        diameter_px=4.0,
    )
    assert far_off.min() >= 0.0
    assert np.allclose(np.diff(far_off, axis=-1), 10.0)
    with contextlib.closing(CentroidExplorer(background_e=0.0, gradient_e=10.0)) as explorer:
        assert_its_code_gives_its_numbers(explorer)


def asked(explorer, **question):
    """What a page would ask; whether it was answered."""
    asked.count += 1
    explorer.view._asked(explorer.view, {"id": str(asked.count), **question}, [])
    return explorer.view.answered == str(asked.count)


asked.count = 0
WITH_HANDLES = [kind for kind in ALL if kind.handles is not base.Explorer.handles]


def test_what_wants_a_hand_has_a_handle():
    assert {kind.__name__ for kind in WITH_HANDLES} >= {
        "CentroidExplorer",
        "DragPoint",
        "Leverage",
        "YourLayout",
    }


@pytest.mark.parametrize("kind", WITH_HANDLES, ids=lambda kind: kind.__name__)
def test_a_handle_is_named_and_follows_hand_and_keys(kind):
    with contextlib.closing(kind()) as explorer:
        assert explorer.view.handles
        for k, handle in enumerate(explorer.view.handles):
            explorer.reset()
            assert handle["label"] and handle["text"]
            assert 0 < handle["x"] < 1 and 0 < handle["y"] < 1
            for question in (
                {"moves": {str(k): [handle["x"] + 0.05, handle["y"] - 0.1]}},
                {"steps": {str(k): [-1, -1]}},
            ):
                before = explorer.stated, explorer.view.handles[k]["text"]
                assert asked(explorer, **question)
                assert explorer.stated != before[0]
                assert explorer.view.handles[k]["text"] != before[1]
                assert explorer.view.alt == described(explorer)
                assert explorer.message.value == ""


@pytest.mark.parametrize("kind", WITH_HANDLES, ids=lambda kind: kind.__name__)
def test_a_handle_stays_where_it_is_put_and_never_leaves_its_range(kind):
    with contextlib.closing(kind()) as explorer:
        for k in range(len(explorer.view.handles)):
            explorer.reset()
            for place in ([0, 0], [1, 1], [0.0, 1.0]):
                asked(explorer, moves={str(k): place})
                at = explorer.view.handles[k]
                asked(explorer, moves={str(k): [at["x"], at["y"]]})
                again = explorer.view.handles[k]
                assert (again["x"], again["y"]) == pytest.approx((at["x"], at["y"]), abs=1e-9)
            asked(explorer, steps={str(k): [1000, 1000]})
            assert explorer.message.value == ""


def test_the_big_point_goes_where_the_hand_goes():
    with contextlib.closing(lab.DragPoint()) as explorer:
        axes = explorer._data
        place = explorer._picture.place(axes, 12.3, -7.1)
        asked(explorer, moves={"0": place.tolist()})
        assert explorer.settings == {"height": -7.0, "place": 12.5, "seed": 0}
        asked(explorer, steps={"0": [10, 2]})
        assert explorer.settings == {"height": -6.0, "place": 17.5, "seed": 0}


def test_arrows_move_as_the_screen_does_where_an_axis_runs_down():
    with contextlib.closing(CentroidExplorer()) as explorer:
        asked(explorer, steps={"0": [0, 3]})
        assert explorer.settings["offset_y_px"] == -1.5


def test_a_question_is_answered_once_and_again_if_the_page_asks_again():
    with contextlib.closing(lab.DragPoint()) as explorer:
        question = {"id": "a", "steps": {"0": [0, 1]}}
        for _ in range(2):
            explorer.view._asked(explorer.view, question, [])
            assert explorer.view.answered == "a"
            assert explorer.settings["height"] == 16.5
        assert asked(explorer, settle=True)
        assert asked(explorer, steps={"0": [0, 0]})


def test_an_error_on_the_way_does_not_leave_the_page_waiting(monkeypatch):
    with contextlib.closing(lab.DragPoint()) as explorer:
        monkeypatch.setattr(explorer, "update", lambda **_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            explorer.view._asked(explorer.view, {"id": "b", "steps": {"0": [0, 1]}}, [])
        assert explorer.view.answered == "b"


def test_width_and_sharpness_follow_the_page_up_to_twice(made):
    made.reset()
    wide, high = made.size_in
    try:
        for width, ratio, expected in ((420, 1, 420), (420, 1.5, 630), (5000, 2, 200 * wide)):
            asked(made, look={"width": width, "ratio": ratio, "light": True})
            shape = pixels(made).shape
            assert shape[1] == pytest.approx(expected, abs=1)
            assert shape[0] == pytest.approx(expected * high / wide, abs=1)
            assert described(made)
    finally:
        asked(made, look={"width": 100 * wide, "ratio": 1, "light": True})


def test_a_dark_page_gets_a_dark_picture_and_a_light_one_the_old(made):
    made.reset()
    first, look = made.view.png, {"width": 100 * made.size_in[0], "ratio": 1}
    numbers = made.numbers.value
    asked(made, look={**look, "light": False})
    dark = pixels(made)
    assert np.median(dark) < 40
    assert (dark.min(axis=-1) > 200).mean() > 0.002  # light ink
    assert made.numbers.value == numbers
    asked(made, look={**look, "light": True})
    assert made.view.png == first


def test_images_are_no_negatives_on_a_dark_page():
    with contextlib.closing(CentroidExplorer()) as explorer:
        light = explorer._image.get_cmap()
        asked(explorer, look={"width": 840, "ratio": 1, "light": False})
        assert explorer._image.get_cmap() == light


def test_spots_moved_by_hand_are_typed_and_read():
    parse = moved_spots(low=-1.0, high=2.0)
    assert parse("moved", " none ") == ()
    assert parse("moved", "3 0.5 -1; 1 2 2") == ((3, 0.5, -1.0), (1, 2.0, 2.0))
    for text in ("3 0.5", "", "a b c", "0 1 1", "1 3 0"):
        with pytest.raises(ValueError, match="moved must be"):
            parse("moved", text)
    with contextlib.closing(lab.YourLayout()) as explorer:
        place = explorer._picture.place(explorer._spots.axes, 2.0, -1.0)
        asked(explorer, moves={"2": place.tolist()})
        assert explorer.settings["moved"] == ((3, 2.0, -1.0),)
        assert explorer.inputs["moved"].value == "3 2 -1"
        assert "moved=((3, 2.0, -1.0),)" in explorer.view.code


def test_the_nearest_step_of_a_slider():
    slider = Slider("height", 0.0, -1.0, 1.0, 0.1)
    assert [slider.nearest(value) for value in (-7.0, 0.26, 5.0)] == [-1.0, 0.3, 1.0]
    light = LogSlider("light", 10.0, 1.0, 1000.0)
    # By ratio 110 and 120 meet at the root of their product, 114.9.
    assert [light.nearest(value) for value in (0.0, 114.8, 115.0, 1e9)] == [1.0, 110.0, 120.0, 1e3]


def test_a_choice_that_is_not_offered_is_named():
    with pytest.raises(
        ValueError, match=r"rows of A must be one of 'paper', 'pinhole', got 'exact'"
    ):
        MonteCarloExplorer(model="exact")


def chain(**settings):
    """What the chain shows at once: settings and numbers by label."""
    with contextlib.closing(ChainExplorer(**settings)) as explorer:
        cells = re.findall(r"<small>(.*?)</small><br>(.*?)</div>", explorer.numbers.value)
        return explorer.experiment(**explorer.settings), dict(cells)


def test_the_chain_shows_huber_beside_rlm_and_both_beside_least_squares():
    for settings in ({}, {"layout": "table 2"}, {"sigma_y_px": 4.0, "frames": 50}):
        seen, numbers = chain(**settings)
        errors = seen["errors_arcsec"]
        assert np.abs(errors["Huber"] - errors["RLM"]).max() < 1e-8
        assert float(numbers["Huber − RLM (″)"]) < 1e-8
        assert np.abs(errors["Huber"][:2]).max() < np.abs(errors["least squares"][:2]).max()


def test_the_chain_without_bad_spots_keeps_its_promise():
    inside = []
    for seed in range(8):
        seen = ChainExplorer.experiment(
            **defaults(ChainExplorer) | {"bad_percent": 0, "seed": seed}
        )
        sigma = np.sqrt(np.diag(seen["covariance_arcsec2"]))
        inside += (seen["errors_arcsec"]["least squares"] / sigma).tolist()
    assert 0.7 < np.std(inside) < 1.3  # 24 draws of one: 0.86 to 1.14 in two of three cases
    assert np.abs(inside).max() < 4.0


def test_the_chain_weighs_a_wide_direction_less():
    seen, _ = chain(
        sigma_x_px=1.5, sigma_y_px=4.0, window_px=25, bad_percent=0, read_noise_e=0, background_e=0
    )
    across, down = np.sqrt(np.diag(seen["covariance_arcsec2"]))[[1, 0]]
    assert down > 2.0 * across


def test_a_lost_spot_of_the_chain_stays_nan_and_leaves_no_row():
    seen, numbers = chain(light_e=2.5e3, read_noise_e=20, frames=10)
    lost = np.isnan(seen["found"].xy[..., 0])
    assert 0 < lost.sum() < lost.size / 2
    assert numbers["lost"] == f"{lost.sum()} of {lost.size}"
    assert np.isnan(seen["huber"].residuals.ravel()).sum() == 2 * lost.sum()
    assert np.abs(seen["errors_arcsec"]["Huber"] - seen["errors_arcsec"]["RLM"]).max() < 1e-8


def test_the_chain_is_quick_only_while_a_page_watches_and_settles_after():
    with contextlib.closing(ChainExplorer(frames=60)) as explorer:
        final = explorer.view.png
        put(explorer, frames=60)
        assert explorer.view.png == final and not explorer.view.coarse
        asked(explorer, look={"width": 840, "ratio": 1, "light": True})
        asked(explorer, steps={"0": [1, 0]})
        assert explorer.view.coarse and explorer.moving
        assert "of 160" in explorer.numbers.value  # 20 of the 60 frames
        asked(explorer, steps={"0": [-1, 0]})
        asked(explorer, settle=True)
        assert not explorer.view.coarse
        assert "of 480" in explorer.numbers.value


def test_a_warm_up_is_fitted_over_every_lag_once_the_hand_rests():
    with contextlib.closing(ThermalExplorer()) as explorer:
        put(explorer, lag_min=20.0)
        at_rest = explorer.numbers.value
        assert "when it rests" not in at_rest and not explorer.view.coarse
        explorer.reset()
        asked(explorer, look={"width": 840, "ratio": 1, "light": True})
        explorer.inputs["lag_min"].value = 20.0
        assert explorer.view.coarse
        assert explorer.numbers.value.count("when it rests") == 3
        moving = explorer.view.png
        asked(explorer, settle=True)
        assert not explorer.view.coarse
        assert explorer.numbers.value == at_rest and explorer.view.png == moving


def test_the_chain_takes_a_camera_of_ones_own(tmp_path):
    path = tmp_path / "camera.toml"
    path.write_text(lb.Camera(focal_mm=500.0, pixel_um=5.0, shape=(500, 600)).to_toml())
    seen, _ = chain(camera_file=str(path))
    assert seen["camera"].shape == (500, 600)
    assert seen["places"].max() < 600
    with contextlib.closing(ChainExplorer()) as explorer:
        put(explorer, camera_file="nowhere.toml")
        assert "camera file must be &#x27;none&#x27; or the path" in explorer.message.value
        path.write_text("focal_mm = 1\n")
        put(explorer, camera_file=str(path))
        assert "camera.toml" in explorer.message.value


def test_an_ellipse_is_drawn_around_a_normal_cloud_alone():
    rng = np.random.default_rng(4)
    cloud = rng.standard_normal((400, 2)) @ [[2.0, 0.5], [0.0, 1.0]]
    outline = irls_room._ellipse(cloud)
    assert np.isfinite(outline).all()
    assert np.abs(outline[0]).max() == pytest.approx(2.4477 * 2.0, rel=0.15)
    two_heaps = cloud + np.where(np.arange(400)[:, None] % 4, 0.0, 8.0)
    assert np.isnan(irls_room._ellipse(two_heaps)).all()
