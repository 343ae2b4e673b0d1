"""Several photographs of one camera: pooled, and each named if something is wrong with it."""

import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scenes import squares

import trisquare as ts
from trisquare import simulate
from trisquare.cli.console import answer
from trisquare.cli.tables import calibration_report, warning_lines
from trisquare.report import report_page

FIRST = squares(51)
SECOND = squares(52, camera=FIRST.camera)
PICTURES = [
    simulate.render(scene, np.random.default_rng(seed), noise=2.0, tone="srgb")
    for seed, scene in enumerate((FIRST, SECOND))
]
BLANK = np.full_like(PICTURES[0], 128)


@pytest.fixture
def paths(tmp_path):
    written = {}
    for name, picture in zip("abc", (*PICTURES, BLANK), strict=True):
        written[name] = tmp_path / f"{name}.png"
        cv2.imwrite(str(written[name]), picture)
    return written


def test_a_picture_without_squares_is_named_and_left_out(run, tmp_path, paths):
    result = ts.calibrate([paths["a"], paths["c"], paths["b"]])
    assert [plane.image for plane in result.planes] == [0, 0, 0, 2, 2, 2]
    (text,) = (own for own in result.warnings if own.code == "nothing_found")
    assert text.startswith("picture 1 (c.png): the picture is nearly ")
    assert "no square" in text
    # The rejected picture's tone curve is a parameter without data, which changes only the
    # rounding.
    assert result.camera.fx == pytest.approx(ts.calibrate(PICTURES).camera.fx, rel=1e-13)
    assert result.pictures == ("a.png", "c.png", "b.png")
    over = tmp_path / "over.png"
    code, out, _ = run("calibrate", paths["a"], paths["c"], "--overlay", over, "--json")
    assert code == 0
    assert len(json.loads(out)["planes"]) == 3
    assert json.loads(out)["pictures"] == ["a.png", "c.png"]
    assert (tmp_path / "over-2.png").exists()


def test_files_are_named_where_pictures_are_counted(run, tmp_path, paths):
    """A user looks for a photograph on the disk, not for an index."""
    result = ts.calibrate([paths["a"], PICTURES[1]])
    assert result.pictures == ("a.png", "")
    assert ts.Calibration.from_json(result.to_json()).pictures == result.pictures
    assert result == ts.calibrate(PICTURES)
    assert hash(result) == hash(ts.calibrate(PICTURES))
    # Under a wrong curve the estimate of gamma is rough: that of the first scene is 1.8.
    third = squares(54, camera=FIRST.camera)
    picture = simulate.render(third, np.random.default_rng(2), noise=2.0, tone="srgb")
    cv2.imwrite(str(paths["a"]), picture)
    code, out, err = run("calibrate", paths["b"], paths["c"], paths["a"], "--tone", "1.1", "-v")
    assert code == 0
    assert "\npictures: 0 b.png, 1 c.png, 2 a.png\n" in out
    assert "picture 0 (b.png): a gamma of about 2." in err
    assert "picture 2 (a.png): a gamma of about 2." in err


def test_a_warning_about_a_plane_says_in_which_file_it_is():
    result = ts.calibrate([PICTURES[0], PICTURES[1]])
    about = ts.CalibrationWarning("bent", "side_rejected", plane=4)
    told = replace(result, warnings=(about,), pictures=("a.png", "b.png"))
    (line,) = warning_lines(told)
    assert line == "warning (medium): bent [side_rejected; plane 4 is in picture 1 (b.png)]"
    (line,) = warning_lines(replace(told, pictures=()))
    assert line == "warning (medium): bent [side_rejected]"


def test_a_plane_that_is_not_used_says_so(capsys):
    result = ts.calibrate([PICTURES[0], PICTURES[1]])
    first, *others = result.planes
    assert first.is_used
    assert "rejection" not in json.loads(result.to_json())["planes"][0]
    told = replace(result, planes=[replace(first, rejection="it is bent"), *others])
    assert not told.planes[0].is_used
    again = ts.Calibration.from_json(told.to_json())
    assert again.planes[0].rejection == "it is bent"
    assert repr(again.planes[0]).endswith(", rejected: it is bent>")
    assert f"over {len(others)} planes" in repr(again)
    answer(False, False, {}, calibration_report(again))
    out = capsys.readouterr().out
    assert re.search("^ +0 unused +square +0 ", out, re.MULTILINE)
    assert "\nplane 0 is not used: it is bent\n" in out
    page = report_page(again, PICTURES[:2]).decode()
    assert "square (not used: it is bent)" in page
    assert f"calibrated from {len(others)} planes in" in page


def test_a_picture_given_twice_counts_once(paths):
    result = ts.calibrate([paths["a"], *PICTURES])
    once = ts.calibrate(PICTURES)
    assert result.std["fx"] == pytest.approx(once.std["fx"], rel=1e-6)
    assert any("picture 1 is the same picture as picture 0 (a.png)" in t for t in result.warnings)
    noisy = simulate.render(FIRST, np.random.default_rng(9), noise=2.0, tone="srgb")
    assert len(ts.calibrate([PICTURES[0], noisy]).planes) == 6


@pytest.mark.parametrize("change", ["JPEG", "brighter"])
def test_a_picture_saved_again_counts_once(change):
    picture = simulate.render(FIRST, np.random.default_rng(9), noise=4.0, tone="srgb")
    if change == "JPEG":
        again = cv2.imdecode(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 90])[1], 0)
    else:
        again = cv2.add(picture, 3)
    result = ts.calibrate([picture, again])
    (warning,) = (each for each in result.warnings if each.code == "repeated_picture")
    assert warning.startswith("picture 1 shows the same as picture 0, with the same noise")
    assert result.std["fx"] == pytest.approx(ts.calibrate(picture).std["fx"], rel=0.01)


def test_pictures_of_different_sizes_are_named(tmp_path, paths):
    other = tmp_path / "small.png"
    cv2.imwrite(str(other), BLANK[:480, :640])
    with pytest.raises(ValueError, match=r"small\.png.* 640 x 480 .*a\.png.* 1280 x 960:"):
        ts.calibrate([paths["a"], other])


def test_a_picture_of_another_size_than_most_is_left_out(tmp_path, paths):
    other = tmp_path / "small.png"
    cv2.imwrite(str(other), PICTURES[0][:-1])
    result = ts.calibrate([other, paths["a"], paths["b"]])
    (warning,) = (w for w in result.warnings if w.code == "other_size")
    assert warning.startswith("picture 0 (small.png) is 1280 x 959 pixels")
    assert [plane.image for plane in result.planes] == [1, 1, 1, 2, 2, 2]
    assert {figure.image for figure in result.edges} == {1, 2}
    alone = ts.calibrate([paths["a"], paths["b"]])
    assert (result.camera.fx, result.std) == (alone.camera.fx, alone.std)


def test_an_initial_camera_of_another_size_is_told_before_anything_is_searched(monkeypatch):
    from trisquare.measurement import measure

    known = ts.calibrate(PICTURES[0]).camera
    small = [picture[:-2] for picture in PICTURES]

    def unwanted(*arguments):
        raise AssertionError("a picture is searched")

    monkeypatch.setattr(measure, "search", unwanted)
    for pictures in (small[0], small, BLANK[:-2]):
        with pytest.raises(ValueError, match=r"pictures of 1280 x 960, these have 1280 x 958"):
            ts.calibrate(pictures, initial=known)


def test_pictures_of_another_size_than_most_do_not_go_with_the_initial_camera():
    known = ts.calibrate(PICTURES[0]).camera
    result = ts.calibrate([PICTURES[0][:-2], *PICTURES], initial=known)
    assert [warning.code for warning in result.warnings] == ["other_size"]
    assert [plane.image for plane in result.planes] == [1, 1, 1, 2, 2, 2]


def test_pictures_of_different_depth_need_one_stated_tone():
    deep = BLANK.astype(np.uint16) * 257
    with pytest.raises(ValueError, match=r"picture 1 has uint16 pixels.* give one tone curve"):
        ts.calibrate([BLANK, deep])


def test_an_unreadable_file_among_many_is_named(run, tmp_path, paths):
    broken = tmp_path / "broken.png"
    broken.write_bytes(paths["b"].read_bytes()[:5000])
    code, _, err = run("calibrate", paths["a"], broken, paths["b"])
    assert code == 5
    assert "broken.png: the PNG is truncated" in err


def test_progress_is_told_for_every_picture(paths):
    told = []
    ts.calibrate(list(paths.values()), progress=lambda done, total: told.append((done, total)))
    assert told == [(1, 3), (2, 3), (3, 3)]


def test_what_takes_long_is_logged(caplog):
    with caplog.at_level("INFO", logger="trisquare"):
        result = ts.calibrate(PICTURES[0])
    measured, fitting, fitted = (record.getMessage() for record in caplog.records)
    assert measured == "picture 0: 3 figures measured; 1 of 1"
    assert fitting == "fitting a radial2 camera to 3 figures"
    assert fitted == f"radial2 camera of 3 planes, rms {result.rms:.3g} px"


@pytest.mark.parametrize("pair", [2, 4, 5])
def test_frames_of_two_pictures_with_unknown_tone_are_all_used(pair):
    camera = simulate.TrueCamera(900.0, 900.0, 640.0, 480.0, [-0.1, 0.02, 0.0, 0.0, 0.0])
    pictures = []
    for number in range(2):
        rng = np.random.default_rng([5, pair, number])
        scene = simulate.random_scene(rng, camera=camera, kind="frame")
        pictures.append(simulate.render(scene, rng, noise=2.0, blur=0.8, tone="srgb"))
    result = ts.calibrate(pictures)
    assert len(result.planes) == 6
    assert abs(result.camera.fx - camera.fx) < 4.0 * result.std["fx"]
