"""Pictures with faults by the camera or a program."""

import re

import cv2
import numpy as np
import pytest
from quick import first_quick
from scenes import assert_within, errors_in_std, squares

import trisquare as ts
from trisquare import simulate
from trisquare.calibration.explain_failure import interlaced
from trisquare.calibration.gather import Gathered
from trisquare.detection.kinds import TargetKinds
from trisquare.measurement.find import search
from trisquare.measurement.measure import measure
from trisquare_scenes.broken_assumptions import patterned, shadowed
from trisquare_scenes.picture_faults import (
    UNDAMAGED,
    PictureFault,
    bloomed,
    defocused,
    exposed,
    made_smaller,
    moved,
    photograph,
    sloped,
    styled,
    thresholded,
    winged,
    with_relief,
)

SCENE = squares(131)
FAULTS = {
    "overexposed": PictureFault(on_light=[exposed(1.3)]),
    "thresholded": PictureFault(on_coded=[thresholded(128)]),
    "chromatic_aberration": PictureFault(colour_scales=(0.999, 1.0, 1.0015)),
    "interlaced": PictureFault(second_field=(1.7, 0.4)),
    "motion_blurred": PictureFault(on_light=[moved(5.0, 30.0)]),
}
COLOUR = PictureFault(colour_scales=(1.0, 1.0, 1.0))


def photo(fault, seed=132, scene=SCENE):
    return photograph(scene, np.random.default_rng(seed), fault, noise=2.0, blur=0.8)


@pytest.mark.parametrize("code", FAULTS)
def test_a_fault_is_told_and_the_camera_is_within_its_deviations(code):
    result = ts.calibrate(photo(FAULTS[code]))
    told = {warning.code: warning for warning in result.warnings}
    assert code in told
    assert told[code].severity == "low"
    assert "no_tone_curve" not in told
    assert_within(result, SCENE, 4)


@pytest.mark.parametrize("seed", first_quick([160, 161, 167]))
def test_ringing_of_jpeg_beside_clipped_light_is_not_taken_for_light(seed):
    scene = squares(seed)
    fault = PictureFault(on_light=[exposed(1.6)], jpeg_quality=85)
    result = ts.calibrate(photo(fault, seed, scene))
    assert "overexposed" in {warning.code for warning in result.warnings}
    assert_within(result, scene, 4)


@pytest.mark.parametrize("fault", [UNDAMAGED, COLOUR], ids=["grey", "colour"])
def test_an_undamaged_picture_is_not_warned_of(fault):
    picture = photo(fault, 133)
    result = ts.calibrate(picture)
    assert (result.stage, result.warnings) == ("pixels", ())
    assert_within(result, SCENE, 4)


@pytest.mark.parametrize("corner_blur", [1.0, 1.6])
def test_blur_that_grows_towards_the_corners_is_no_fault(corner_blur):
    even = ts.calibrate(photo(UNDAMAGED, 134))
    result = ts.calibrate(photo(PictureFault(corner_blur=corner_blur), 134))
    assert (result.stage, result.warnings) == ("pixels", ())
    assert_within(result, SCENE, 4)
    assert result.std["fx"] < 2.0 * even.std["fx"]


@pytest.mark.parametrize("seed", first_quick([135, 136, 137]))
def test_wings_of_a_blur_contradict_no_stated_tone(seed):
    picture = photo(PictureFault(on_light=[winged(0.1, 2.0)]), seed)
    result = ts.calibrate(picture, tone="srgb")
    assert {warning.code for warning in result.warnings} <= {"pixels_not_used"}
    assert_within(result, SCENE, 4)


@pytest.mark.parametrize("seed", first_quick([150, 151, 152, 153]))
def test_a_blur_that_is_not_normal_is_no_tone_curve(seed):
    """A disc makes both shoulders of an edge narrower, a tone curve only one of them."""
    scene = squares(seed)
    picture = photo(PictureFault(on_light=[defocused(1.6)]), seed, scene)
    result = ts.calibrate(picture)
    assert (result.stage, result.warnings) == ("pixels", ())
    assert result.tone == pytest.approx(2.2, abs=4 * result.tone_std + 0.03)
    assert_within(result, scene, 4)
    assert not ts.calibrate(picture, tone="srgb").warnings


@pytest.mark.parametrize("seed", first_quick([145, 143, 148, 149]))
def test_light_that_differs_under_a_tone_that_is_no_gamma_is_reckoned_with(seed):
    scene = squares(seed)
    fault = PictureFault(on_light=[sloped(0.4, 30.0 * seed)], on_coded=[styled(6.0)])
    result = ts.calibrate(photo(fault, seed, scene))
    assert "no_tone_curve" in {warning.code for warning in result.warnings}
    assert_within(result, scene, 4)


@pytest.mark.slow
def test_colours_and_rows_that_disagree_cost_no_more_than_what_is_left_out():
    whole = ts.calibrate(photo(UNDAMAGED))
    for code in ("chromatic_aberration", "interlaced"):
        mended = ts.calibrate(photo(FAULTS[code]))
        assert mended.stage == "pixels"
        assert mended.std["fx"] < 2.0 * whole.std["fx"]


@pytest.mark.parametrize("seed", range(140, 143))
def test_moire_is_told_before_what_it_does_to_sides(seed):
    plain = photo(UNDAMAGED, seed)
    result = ts.calibrate(patterned(np.random.default_rng(seed), plain))
    first = result.warnings[0]
    assert (first.code, first.severity) == ("periodic_pattern", "medium")
    dark, light = np.percentile(plain, [1, 99])
    told = float(re.search(r"waves of (\d+) %", first)[1])
    assert told == pytest.approx(8.0 * light / (light - dark), abs=1.0)
    assert_within(result, SCENE, 4)


@pytest.mark.parametrize(("blur", "is_told"), [(2.0, False), (3.5, True)])
def test_a_picture_out_of_focus_is_told(blur, is_told):
    picture = photograph(SCENE, np.random.default_rng(145), UNDAMAGED, noise=2.0, blur=blur)
    result = ts.calibrate(picture)
    told = [warning for warning in result.warnings if warning.code == "out_of_focus"]
    assert len(told) == is_told
    if is_told:
        assert told[0].severity == "medium"
        shown = float(re.search(r"by ([\d.]+) px", told[0])[1])
        assert shown == pytest.approx(np.hypot(blur, 1 / np.sqrt(12)), abs=0.2)
    assert_within(result, SCENE, 4)


@pytest.mark.parametrize(
    ("seed", "blur"), first_quick([(31, 2.0), (32, 4.0), (36, 2.0), (33, 8.0)])
)
def test_a_blur_after_the_coding_hides_a_shift_that_is_reckoned_with(seed, blur):
    """Blurred values show nearly no tone curve, but its shift of the edges remains."""
    scene = squares(seed)
    picture = simulate.render(scene, np.random.default_rng(seed), noise=2.0, blur=0.8, tone="srgb")
    assert_within(ts.calibrate(cv2.GaussianBlur(picture, (0, 0), blur)), scene, 4)


@pytest.mark.parametrize("seed", first_quick([42, 41, 44]))
def test_a_picture_made_smaller_after_the_coding_is_within_its_deviations(seed):
    drawn = simulate.random_scene(np.random.default_rng(seed), image_size=(2560, 1920))
    whole = photo(UNDAMAGED, seed, drawn)
    scene, picture = made_smaller(drawn, whole, (1280, 960))
    assert_within(ts.calibrate(picture), scene, 4)


@pytest.mark.parametrize("seed", first_quick([107, 104]))
def test_hard_compression_is_no_interlacing(seed):
    scene = squares(seed)
    picture = simulate.render(scene, np.random.default_rng(seed), noise=0.5, blur=0.5, tone="srgb")
    _, coded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 8])
    result = ts.calibrate(cv2.imdecode(coded, cv2.IMREAD_UNCHANGED))
    assert "interlaced" not in [warning.code for warning in result.warnings]


@pytest.mark.parametrize("seed", range(180, 184))
def test_rows_far_apart_are_named_whatever_becomes_of_the_picture(seed):
    picture = photo(PictureFault(second_field=(7.0, 2.0)), seed, squares(seed))
    try:
        said = [warning.code for warning in ts.calibrate(picture).warnings]
    except ts.TrisquareError as error:
        said = str(error)
    assert "interlaced" in said or "photograph without interlacing" in said


@pytest.mark.parametrize(
    "gains",
    [
        [[1.0], [0.7]],
        [[0.5, 1.0], [1.0, 0.6]],
    ],
)
def test_rows_of_unequal_gain_are_not_two_moments(gains):
    whole = photo(UNDAMAGED).astype(float)
    gain = np.tile(gains, (whole.shape[0] // 2, whole.shape[1] // len(gains[0])))
    picture = np.rint(whole.reshape(gain.shape) * gain).astype(np.uint8)
    assert not search(picture, TargetKinds.parse("squares")).is_interlaced()


def test_the_pictures_of_two_moments_are_named():
    scene = squares(183)
    whole = photo(UNDAMAGED, 183, scene)
    combed = photo(PictureFault(second_field=(9.0, 3.0)), 183, scene)
    found = [search(picture, TargetKinds.parse("squares")) for picture in (whole, combed)]
    assert [own.is_interlaced() for own in found] == [False, True]
    names = ["a.png", "b.png"]
    (warning,) = interlaced(Gathered(names=names, searches=dict(enumerate(found))))
    assert str(warning).endswith("photograph without interlacing (b.png)")


def test_shadows_and_compression_are_no_pattern():
    shadow = shadowed(np.random.default_rng(143), photo(UNDAMAGED, 143))
    for picture in (shadow, photo(PictureFault(jpeg_quality=30), 144)):
        measured = measure(picture, TargetKinds.parse("squares"), "srgb", None)
        assert measured.figures
        assert measured.faults.pattern is None


def test_a_small_aberration_is_taken_out_untold():
    fault = PictureFault(colour_scales=(0.9997, 1.0, 1.0003))
    result = ts.calibrate(photo(fault, 135))
    assert result.warnings == ()
    assert_within(result, SCENE, 4)


def test_a_stated_tone_is_kept_where_a_picture_is_mended():
    picture = photo(FAULTS["interlaced"])
    result = ts.calibrate(picture, tone="srgb")
    assert [warning.code for warning in result.warnings] == ["interlaced"]
    assert result.tone == "srgb"
    assert_within(result, SCENE, 4)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(136, 139))
def test_blooming_is_told_as_overexposed_and_carried(seed):
    scene = squares(seed)
    fault = PictureFault(on_light=[exposed(1.5), bloomed(0.3, 3.0)])
    try:
        result = ts.calibrate(photo(fault, seed, scene))
    except ts.DegenerateGeometryError:
        return  # too little is left
    assert "overexposed" in {warning.code for warning in result.warnings}
    assert abs(errors_in_std(result, scene)["fx"]) < 4


@pytest.mark.slow
def test_pixels_are_not_fitted_where_paper_is_bent_everywhere():
    scene = with_relief(squares(143), np.random.default_rng(143), 0.01)
    result = ts.calibrate(photo(UNDAMAGED, 144, scene))
    codes = {warning.code for warning in result.warnings}
    assert result.stage == "edges"
    assert "side_partly_hidden" not in codes
    assert codes & {"correlated_residuals", "plane_disagrees", "planes_contradict"}
