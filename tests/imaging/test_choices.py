"""A choice is an object: what it says by name, beside what it cannot stand, and how a new one is made."""

import inspect
import pickle
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from noisy_spots import CAMERA

import losbench as lb
from losbench.imaging.protocols import Estimate

START = [[30.0, 20.0], [60.0, 32.0]]
FRAMES = CAMERA.expose(
    np.repeat(lb.render_spots(START, 4e4, 2.0, (50, 90))[None], 6, axis=0) + 100.0, 3
)

OBJECTS = [
    lb.EIWA(15),
    lb.EIWA(15, "step", 1e-4, max_iter=9, centre="peak", hot_pixel_gate=True),
    lb.Grey(13, centre="start"),
    lb.Weighted([1.9, 2.1], window=13, tolerance=1e-4),
    lb.Gaussian(2.0, window=13, max_iter=30),
]
NAMED = [
    {"method": "eiwa", "window": 15},
    {
        "window": 15,
        "stop": "step",
        "tolerance": 1e-4,
        "max_iter": 9,
        "centre": "peak",
        "hot_pixel_gate": True,
    },
    {"method": "grey", "window": 13, "centre": "start"},
    {"method": "weighted", "sigma": [1.9, 2.1], "window": 13, "tolerance": 1e-4},
    {"method": "gaussian", "width": 2.0, "window": 13, "max_iter": 30},
]


def same(one, other):
    for name in ("xy", "sigma_xy", "flux", "background", "n_iter", "flags"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert one.window == other.window


@pytest.mark.parametrize(("choice", "named"), list(zip(OBJECTS, NAMED, strict=True)))
def test_a_name_with_fields_is_the_object(choice, named):
    same(
        lb.centroid(FRAMES, START, method=choice, detector=CAMERA),
        lb.centroid(FRAMES, START, noise=CAMERA, **named),
    )


@pytest.mark.parametrize(
    ("background", "named"),
    [
        (lb.Ring(), {"background": "ring"}),
        (lb.Ring(19), {"ring": 19}),
        (lb.Level(150.0), {"background": 150.0}),
        (None, {"background": "none"}),
        (lb.Level(0.0), {"background": "none"}),
    ],
)
def test_a_background_by_name_is_the_object(background, named):
    method = lb.EIWA(13)
    same(
        lb.centroid(FRAMES, START, method=method, background=background),
        lb.centroid(FRAMES, START, method=method, **named),
    )


@pytest.mark.parametrize("choice", [*OBJECTS, lb.Ring(19), lb.Level(3.0)])
def test_a_choice_can_be_handed_on(choice):
    again = pickle.loads(pickle.dumps(choice))
    assert again == choice and hash(again) == hash(choice)
    assert "ClassVar" not in repr(choice) and repr(choice).startswith(type(choice).__name__)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"method": lb.EIWA(13), "window": 15},
            r"window and method exclude each other: got window=15 beside method=EIWA\(window=13",
        ),
        ({"method": lb.Weighted(), "sigma": 2.0}, "sigma and method exclude each other"),
        ({"method": lb.Grey(), "stop": "step"}, "stop and method exclude each other"),
        (
            {"background": lb.Ring(19), "ring": 21},
            r"ring and background exclude each other: got ring=21 beside background=Ring\(side=19",
        ),
        ({"background": "none", "ring": 21}, "ring and background exclude each other"),
        (
            {"method": "weighted", "width": 2.0, "sigma": 2.0},
            "width and sigma are two words for one thing",
        ),
        ({"detector": CAMERA, "noise": CAMERA}, "detector and noise are two words"),
        (
            {"method": 3},
            "method must be one of 'auto', 'eiwa', 'grey', 'weighted', 'likelihood', 'gaussian', 'empirical', got 3",
        ),
    ],
)
def test_one_thing_said_twice_is_refused_by_both_names(options, message):
    with pytest.raises(ValueError, match=message):
        lb.centroid(FRAMES, START, **options)


def test_a_mistyped_field_is_no_field():
    with pytest.raises(TypeError, match="'windw'"):
        lb.centroid(FRAMES, START, windw=13)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: lb.EIWA(12), "window must be odd, got 12"),
        (lambda: lb.EIWA(1), "window must be a whole number of at least 3, got 1"),
        (lambda: lb.EIWA(stop="soon"), "stop must be one of 'error', 'step', got 'soon'"),
        (lambda: lb.EIWA(tolerance=0.0), "tolerance must be"),
        (lambda: lb.EIWA(max_iter=0), "max_iter must be"),
        (lambda: lb.Grey(centre="left"), "centre must be one of 'start', 'peak', got 'left'"),
        (lambda: lb.Weighted(hot_pixel_gate=1), "hot_pixel_gate must be True or False, got 1"),
        (lambda: lb.Weighted([1.0, 2.0, 3.0]), r"width \(sigma of a spot\) must be a number, two"),
        (lambda: lb.Gaussian(0.05), "of at least 0.1 pixels, got 0.05"),
        (lambda: lb.Grey(smooth="mean"), "smooth must be one of 'none', 'kalman', got 'mean'"),
        (lambda: lb.Ring(12), "ring must be odd, got 12"),
        (lambda: lb.Level(np.nan), "background must be a finite number"),
    ],
)
def test_a_field_out_of_range_is_named_when_the_object_is_made(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@dataclass(frozen=True)
class Brightest:
    """The brightest pixel: a centroid of one class."""

    window: int | None = None
    centre: str | None = None
    hot_pixel_gate: bool = False
    smooth: str | None = None
    stays: ClassVar[bool] = True
    template: ClassVar[bool] = False
    width: ClassVar[None] = None

    def measure(self, windows):
        count, side, _ = windows.signal.shape
        row, column = np.divmod(windows.signal.reshape(count, -1).argmax(axis=1), side)
        nothing, ones = np.zeros(count), np.ones(count)
        place = np.column_stack([column, row]) - side // 2.0
        return Estimate(
            centroid=place,
            sigma=np.full((count, 2), 0.3),
            flux=windows.signal.max(axis=(1, 2)).astype(float),
            sigma_flux=nothing,
            n_iter=ones.astype(int),
            converged=ones.astype(bool),
            middle=np.zeros((count, 2)),
            slow=nothing.astype(bool),
            misfit=nothing.astype(bool),
        )


def test_a_new_centroid_is_one_class():
    found = lb.centroid(FRAMES, START, method=Brightest(9))
    assert np.abs(found.xy - START).max() <= 1.0
    assert found.window == 9


def test_the_path_ends_where_the_centroid_is():
    for choice in (lb.EIWA(13), lb.EIWA(13, "step"), lb.EIWA(15, centre="peak")):
        path = choice.path(FRAMES[0], [32.6, 18.1])
        found = lb.centroid(FRAMES[0], [[32.6, 18.1]], method=replace(choice, centre="start"))
        np.testing.assert_array_equal(path[0], [32.6, 18.1])
        np.testing.assert_array_equal(path[-1], found.xy[0])
        assert len(path) == found.n_iter[0] + 1


def test_places_smoothed_over_the_frames_scatter_less():
    frames = CAMERA.expose(
        np.repeat(lb.render_spots(START, 4e3, 2.0, (50, 90))[None], 80, axis=0) + 100.0, 4
    )
    raw = lb.centroid(frames, START, method=lb.EIWA(13))
    smooth = lb.centroid(frames, START, method=lb.EIWA(13, smooth="kalman"))
    assert (smooth.xy - START).std() < 0.5 * (raw.xy - START).std()


def test_every_flag_has_a_sentence_and_the_docstring_is_made_of_them():
    text = " ".join(inspect.getdoc(lb.SpotFlag).split())
    for flag in lb.SpotFlag:
        assert flag.sentence.endswith(".") and len(flag.sentence) > 20
        assert f"{flag.name} = {flag.value} {flag.sentence}" in text
    assert pickle.loads(pickle.dumps(lb.SpotFlag(10))) == lb.SpotFlag.EDGE | lb.SpotFlag.NEIGHBOUR


def test_without_a_centroid_means_without():
    """The flags that say so, and only they, leave NaN."""
    dark = CAMERA.expose(np.full((50, 90), 100.0), 1)
    found = lb.centroid(dark, [[30.0, 20.0], [-9.0, 4.0]], method=lb.EIWA(13))
    flags = [lb.SpotFlag(bits) for bits in found.flags.tolist()]
    assert flags[0] & lb.SpotFlag.TOO_FAINT and flags[1] == lb.SpotFlag.MISSING
    assert np.isnan(found.xy).all()
    assert not any(flag.keeps_xy for flag in (lb.SpotFlag.TOO_FAINT, lb.SpotFlag.MISSING))


def test_centroids_show_themselves_in_a_dozen_lines():
    found = lb.centroid(FRAMES, START, method=lb.EIWA(13), detector=CAMERA)
    html = found._repr_html_()
    assert html.count("<tr>") <= 12 and "±" in html and "2 spots in 6 frames" in html
    many = lb.centroid(FRAMES[0], START * 20, method=lb.EIWA(13))._repr_html_()
    assert len(many.splitlines()) <= 13
    assert "NEIGHBOUR" in many and "and 32 more" in many
