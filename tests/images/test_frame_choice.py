"""Choice of frames of a video."""

import cv2
import numpy as np
import pytest
from videos import moving, turned_clockwise, write_frames

from trisquare.errors import ImageError
from trisquare.images.frame_choice import choose_frames, with_frames
from trisquare.images.limits import PictureLimits
from trisquare.images.photographs import Photographs
from trisquare.images.pixels import VideoFrame
from trisquare.images.video import Video

VIEWS = moving(4, step=60)


def numbers(frames):
    return [frame.number for frame in frames]


@pytest.fixture
def panned(tmp_path):
    """Four views of 7 frames each, of which the middle one is sharp."""
    path = tmp_path / "panned.avi"
    blurs = (4, 3, 2, 0, 2, 3, 4)
    frames = [cv2.GaussianBlur(view, (0, 0), b) if b else view for view in VIEWS for b in blurs]
    write_frames(path, frames)
    return path


def test_the_sharpest_frame_of_each_view_is_chosen(panned):
    chosen = choose_frames(panned, 4)
    assert numbers(chosen) == [3, 10, 17, 24]
    for frame, view in zip(chosen, VIEWS, strict=True):
        assert np.abs(frame.pixels.astype(int) - view).mean() < 6  # from the coding
        assert frame.video == str(panned)


def test_fewer_than_there_are_views_are_different_and_sharp(panned):
    assert set(numbers(choose_frames(panned, 2))) < {3, 10, 17, 24}
    assert len(choose_frames(panned, 1)) == 1


def test_the_contrast_and_the_exposure_do_not_matter(tmp_path):
    """A dim sharp frame is preferred to a bright blurred one of the same view."""
    dim = [cv2.convertScaleAbs(view, alpha=0.4, beta=20) for view in VIEWS]
    blurred = [cv2.GaussianBlur(view, (0, 0), 4) for view in VIEWS]
    frames = [frame for pair in zip(dim, blurred, strict=True) for frame in pair]
    write_frames(tmp_path / "clip.avi", frames)
    assert numbers(choose_frames(tmp_path / "clip.avi", 4)) == [0, 2, 4, 6]


def test_equal_and_empty_frames_are_not_chosen(tmp_path):
    """There are only two views and a fade from black, although many frames are requested."""
    black = np.zeros_like(VIEWS[0])
    write_frames(tmp_path / "clip.avi", [black] * 5 + [VIEWS[0]] * 5 + [VIEWS[1]] * 5)
    assert numbers(choose_frames(tmp_path / "clip.avi", 10)) == [5, 10]


def test_all_are_chosen_of_a_short_video(tmp_path):
    write_frames(tmp_path / "clip.avi", moving(5))
    told = []
    chosen = choose_frames(tmp_path / "clip.avi", 9, progress=lambda *it: told.append(it))
    assert numbers(chosen) == [0, 1, 2, 3, 4]
    assert told == [(done, 5) for done in range(1, 6)]


def test_videos_among_pictures_are_replaced(panned):
    picture = VIEWS[0]
    before, *frames, after = with_frames([picture, panned, "photo.jpg"], 4)
    assert before is picture
    assert after == "photo.jpg"
    assert all(isinstance(frame, VideoFrame) for frame in frames)
    assert numbers(frames) == [3, 10, 17, 24]
    assert with_frames([panned], None) == [panned]


def test_it_is_said_that_the_frames_of_a_portrait_video_are_not_turned(tmp_path):
    path = tmp_path / "clip.mp4"
    write_frames(path, moving(3))
    level = path.read_bytes()
    for content, codes in ((turned_clockwise(level), {"orientation_ignored"}), (level, set())):
        path.write_bytes(content)
        for photograph in Photographs(choose_frames(path, 2)):
            assert photograph.pixels.shape == (120, 160, 3)
            assert set(photograph.remarks) == codes


def test_bad_arguments_are_refused(panned, tmp_path):
    with pytest.raises(ValueError, match="at least 1, not 0"):
        with_frames([panned], 0)
    with pytest.raises(TypeError, match="frames"):
        with_frames([panned], 2.5)
    with pytest.raises(ValueError, match="no video is given"):
        with_frames(["photo.jpg", VIEWS[0]], 3)
    panned.write_bytes(panned.read_bytes()[: panned.stat().st_size // 2])
    with pytest.raises(ImageError, match="truncated"):
        with_frames([panned], 3)


def test_a_video_of_too_many_frames_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "clip.avi"
    write_frames(path, moving(5))
    assert len(choose_frames(path, 2, PictureLimits(max_frames=5))) == 2
    said = r"clip\.avi: has more than the 4 frames that max_frames allows"
    with pytest.raises(ImageError, match=said):
        choose_frames(path, 2, PictureLimits(max_frames=4))
    monkeypatch.setenv("TRISQUARE_MAX_FRAMES", "4")
    with pytest.raises(ImageError, match=said):
        choose_frames(path, 2)


def test_frames_that_are_not_stated_count_as_well(tmp_path, monkeypatch):
    path = tmp_path / "clip.avi"
    write_frames(path, moving(5))
    whole = Video.__init__

    def stating_none(video, *arguments):
        whole(video, *arguments)
        video.stated_frames = 0

    monkeypatch.setattr(Video, "__init__", stating_none)
    assert len(choose_frames(path, 2, PictureLimits(max_frames=5))) == 2
    with pytest.raises(ImageError, match="more than the 4 frames"):
        choose_frames(path, 2, PictureLimits(max_frames=4))


def test_frames_of_a_few_rows_are_judged(tmp_path):
    path = tmp_path / "flat.avi"
    rng = np.random.default_rng(5)
    write_frames(path, list(rng.integers(0, 256, (3, 2, 16000, 3), dtype=np.uint8)))
    assert len(choose_frames(path, 2)) == 2
