"""Defaults of the public face of recordings, which the reference shows."""

import pytest

import losbench as lb
from losbench.recording.angles import Angles
from losbench.recording.frames.raw import RawLayout
from losbench.recording.second import second_opinion


@pytest.mark.parametrize(
    ("thing", "known"),
    [
        (lb.Run, {"chunk": 64, "resume": False, "progress": False, "executor": None, "out": None}),
        (lb.read_recording, {"on_unreadable": "stop", "period_s": None, "roi": None}),
        (lb.open_frames, {"on_unreadable": "stop", "channel": None}),
        (lb.measure, {"reference": "first", "background": "ring", "centroid": None}),
        (second_opinion, {"most": 200, "background": "ring"}),
        (Angles, {"model": "pinhole", "group": "spot", "exact": False, "solver": None}),
        (RawLayout, {"header_bytes": 0, "gap_bytes": 0, "byte_order": "little"}),
        (lb.Recording, {"skip_unreadable": False, "notes": ()}),
    ],
    ids=lambda each: getattr(each, "__name__", ""),
)
def test_defaults_of_the_public_face_are_changed_on_purpose(thing, known, defaults_of):
    found = defaults_of(thing)
    assert {name: found[name] for name in known} == known
