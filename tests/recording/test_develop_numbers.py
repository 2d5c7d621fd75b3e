"""What a stored image becomes, each limit from either side: channels, full scale, left-aligned
numbers."""

import numpy as np
import pytest

from losbench.recording.frames.develop import (
    _full_scale,
    _grey,
    first_readable,
    left_aligned_step,
)
from losbench.recording.frames.protocol import UnreadableFrame

PLANE = np.arange(12, dtype=np.uint8).reshape(3, 4) * 20


def stacked(*planes):
    return np.stack(planes, axis=-1)


def grey(raw, channel=None, like_grey=0):
    return _grey(raw, channel, like_grey, "frame 0")


@pytest.mark.parametrize("dtype", ["u1", "u2", "i2", "f4"])
def test_channels_that_hold_one_grey_image_are_that_image(dtype):
    plane = PLANE.astype(dtype)
    full = np.full_like(plane, 7)
    for raw in (
        plane,
        stacked(plane),
        stacked(plane, full),
        stacked(plane, plane, plane),
        stacked(plane, plane, plane, full),
    ):
        np.testing.assert_array_equal(grey(raw), plane)
    one = stacked(plane[:1, :1], plane[:1, :1], plane[:1, :1], full[:1, :1])
    assert grey(one).tolist() == plane[:1, :1].tolist()


@pytest.mark.parametrize("at", [(0, 0), (0, 1), (1, 0), (2, 3)])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_transparency_of_which_one_pixel_differs_is_refused(at, channels):
    alpha = np.full_like(PLANE, 255)
    alpha[at] = 254
    raw = stacked(*[PLANE] * channels, alpha)
    with pytest.raises(UnreadableFrame, match="a channel of transparency that is not the same"):
        grey(raw)
    np.testing.assert_array_equal(grey(raw, channel=channels), alpha)
    np.testing.assert_array_equal(grey(raw, channel=0), PLANE)


@pytest.mark.parametrize("dtype", ["u1", "u2", "i2", "f4"])
@pytest.mark.parametrize("which", [0, 2])
@pytest.mark.parametrize(
    ("apart", "like_grey", "read"), [(3, 3, True), (4, 3, False), (1, 0, False)]
)
@pytest.mark.parametrize("sign", [1, -1])
def test_colours_are_grey_as_far_as_they_differ_by_no_more(
    dtype, which, apart, like_grey, read, sign
):
    planes = [PLANE.astype(dtype) + np.asarray(10, dtype) for _ in range(3)]
    planes[which][1, 2] = planes[1][1, 2] + np.asarray(sign * apart).astype(dtype)
    raw = stacked(*planes)
    if read:
        np.testing.assert_array_equal(grey(raw, like_grey=like_grey), planes[1])
    else:
        with pytest.raises(UnreadableFrame, match="got 3 colour channels that differ"):
            grey(raw, like_grey=like_grey)


@pytest.mark.parametrize("channels", [5, 6])
def test_more_channels_than_four_are_chosen_from(channels):
    raw = stacked(*[PLANE + np.uint8(k) for k in range(channels)])
    with pytest.raises(UnreadableFrame, match=f"got {channels} colour channels that differ"):
        grey(raw)
    np.testing.assert_array_equal(grey(raw, channel=channels - 1), PLANE + np.uint8(channels - 1))
    with pytest.raises(UnreadableFrame, match=f"got {channels} colour channels"):
        grey(raw, channel=channels)


@pytest.mark.parametrize("shape", [(5,), (2, 3, 4, 3)])
def test_what_has_not_two_or_three_axes_is_no_image(shape):
    with pytest.raises(UnreadableFrame, match="must be one grey image"):
        grey(np.zeros(shape, np.uint8))


def test_complex_colours_are_none():
    with pytest.raises(UnreadableFrame, match="got 3 colour channels that differ"):
        grey(np.zeros((2, 2, 3), np.complex64))


@pytest.mark.parametrize(("codes", "step"), [(15, 1), (16, 16), (40, 16)])
def test_sixteen_codes_that_occur_twice_tell_a_step(codes, step):
    frame = np.repeat(np.arange(codes, dtype=np.uint16) * 16 + 5, 2)
    assert left_aligned_step(frame) == step
    single = np.append(frame, np.uint16(8))  # once: it may be a dead pixel
    assert left_aligned_step(single) == step
    if step > 1:
        assert left_aligned_step(np.append(single, np.uint16(8))) == 1
        assert left_aligned_step(frame * 3) == step  # the power of two in a common factor


@pytest.mark.parametrize(
    ("top", "count", "step", "dtype", "full"),
    [
        (1023, 2, 1, "u2", 1023.0),
        (1023, 1, 1, "u2", 65535.0),
        (1022, 2, 1, "u2", 65535.0),
        (4095, 2, 1, "u2", 4095.0),
        (16383, 2, 1, "u2", 16383.0),
        (4095 * 16, 2, 16, "u2", 4095.0),
        (4095 * 16 - 16, 2, 16, "u2", 4095.0),
        (1023 * 16, 2, 16, "u2", 1023.0),
        (16383, 2, 1, "u4", 16383.0),
        (255, 2, 1, "u1", 255.0),
        (100, 2, 1, "u1", 255.0),
        (100, 2, 1, "i2", 32767.0),
        (100, 2, 1, "f4", None),
    ],
)
def test_a_full_scale_is_that_of_a_converter_if_two_pixels_reach_it(top, count, step, dtype, full):
    plane = np.zeros((5, 5), dtype)
    plane.ravel()[:count] = top
    assert _full_scale(plane, step, None) == full
    assert _full_scale(plane, step, 12) == 4095.0


@pytest.mark.parametrize("good", [0, 1, 3, None])
@pytest.mark.parametrize("skip", [False, True])
def test_the_first_frame_that_can_be_read_is_taken(good, skip):
    tried = []

    def read(k):
        tried.append(k)
        if k != good:
            raise UnreadableFrame(f"frame {k}")
        return "frame"

    if good is None or (good and not skip):
        with pytest.raises(UnreadableFrame, match="frame 3" if skip else "frame 0"):
            first_readable(4, read, skip=skip)
    else:
        assert first_readable(4, read, skip=skip) == (good, "frame")
        assert tried == list(range(good + 1))
