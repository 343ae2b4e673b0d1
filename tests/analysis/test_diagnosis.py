"""Limits of a calibration, and whether the advice has the promised effect."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scenes import IMAGE_SIZE, edges_of, squares

import trisquare as ts
from trisquare import simulate
from trisquare.analysis.diagnosis import diagnose
from trisquare.analysis.plan import predicted
from trisquare.analysis.what_if import changes_of, planes_of

NOISE = 0.05


def result_of(scene, seed=0, **options):
    return ts.calibrate_edges(edges_of(scene, NOISE, seed, spacing=2.0), IMAGE_SIZE, **options)


def with_camera(scene, **changed):
    """The same squares in front of a camera with some changed values."""
    return replace(scene, camera=replace(scene.camera, **changed))


def of_aspect(scene, ratio):
    return with_camera(scene, fy=ratio * scene.camera.fx)


def test_every_free_parameter_is_diagnosed():
    result = result_of(squares(1))
    diagnosis = diagnose(result)
    assert tuple(diagnosis) == result.parameters
    spread = np.sqrt(np.diag(result.covariance))
    correlation = result.covariance / np.outer(spread, spread)
    for i, (name, found) in enumerate(diagnosis.items()):
        assert found.std == result.std[name]
        others = [other for other in result.parameters if other != name]
        assert list(found.correlation) == others
        np.testing.assert_allclose(list(found.correlation.values()), np.delete(correlation[i], i))
        assert found.limits
        assert found.remedy
        assert name in str(diagnosis)
    with pytest.raises(AttributeError):
        diagnosis["fx"].std = 1.0


def test_a_result_from_json_has_the_same_diagnosis():
    result = result_of(squares(2), fix="aspect")
    read = ts.Calibration.from_json(result.to_json())
    assert str(diagnose(read)) == str(diagnose(result))
    assert "fy" not in diagnose(read)


def test_a_rejected_plane_is_no_part_of_what_is_compared():
    result = result_of(squares(1))
    first = replace(result.planes[0], rejection="its side 2 bends")
    rejected = replace(result, planes=(first, *result.planes[1:]))
    assert len(planes_of(rejected)) == len(result.planes) - 1
    moved = [
        change.change
        for change in changes_of(rejected, planes_of(rejected))
        if change.change.startswith("moving plane")
    ]
    assert [text.split()[2] for text in moved] == ["1", "2"]
    used = sum(plane.samples for plane in result.planes[1:])
    assert f"in {used} edge samples" in str(diagnose(rejected))


@pytest.mark.parametrize("seed", [3, 8])
def test_what_square_pixels_would_bring_is_told_wherever_they_help(seed):
    scene = of_aspect(squares(seed), 1.0)
    truth = ts.Camera(scene.camera.K, scene.camera.distortion, IMAGE_SIZE)
    free, held = result_of(scene), result_of(scene, fix="aspect", initial=truth)
    promised = {
        name: float(match[1])
        for name, found in diagnose(free).items()
        if (match := re.search(r"fixing the aspect.* to ([\d.]+)", found.remedy))
    }
    assert "fx" in promised
    for name, std in promised.items():
        assert held.std[name] == pytest.approx(std, rel=0.15)
    assert "aspect" not in str(diagnose(held))


@pytest.mark.parametrize("ratio", [1.0, 1.06])
def test_what_the_estimate_contradicts_is_not_advised(ratio):
    scene = of_aspect(squares(3), ratio)
    result = result_of(scene)
    found = diagnose(result)
    spread = result.std["fx"] + result.std["fy"]
    assert (abs(result.camera.fy - result.camera.fx) > 4 * spread) == (ratio != 1.0)
    assert ("fixing the aspect, since" in str(found)) == (ratio == 1.0)
    for name in ("fx", "fy"):
        assert ("fixing the aspect at 1 is no remedy: fy / fx is 1.06" in found[name].remedy) == (
            ratio != 1.0
        )
    assert "no remedy" not in found["cx"].remedy


@pytest.mark.parametrize("offset", [0.0, 25.0])
def test_a_principal_point_off_the_centre_is_not_to_be_held_there(offset):
    scene = squares(3)
    cx, cy = np.subtract(IMAGE_SIZE, 1) / 2 + offset
    result = result_of(with_camera(scene, cx=cx, cy=cy))
    texts = [planned.change for planned in changes_of(result, planes_of(result))]
    assert any("the principal point, if it is known" in text for text in texts)
    assert "moving plane 0 nearer to the corner of the picture" in texts  # numbered as in tables
    assert any("since it is not the picture's centre" in text for text in texts) == (offset > 0)


@pytest.mark.parametrize("seed", [3, 8])
def test_advice_comes_true(seed):
    """With photographs taken as advised, the stated stds are the promised ones."""
    scene = squares(seed)
    result = result_of(scene)
    planes = planes_of(result)
    before = ts.predict(result.camera, result.planes, NOISE, spacing=2.0).std
    tried = 0
    for planned in changes_of(result, planes):
        try:
            promised = predicted(result.camera, planned.planes, planned.fixed).std
        except ValueError:
            continue
        kind = "frame" if len(planned.planes[0].outlines) == 2 else "square"
        targets = [simulate.Target(p.rotation, p.translation, kind) for p in planned.planes]
        held = [name for name in planned.fixed if name not in result.fixed]
        found = ts.calibrate_edges(
            edges_of(simulate.Scene(scene.camera, tuple(targets)), NOISE, 1, spacing=2.0),
            IMAGE_SIZE,
            fix=held,
            initial=ts.Camera(scene.camera.K, scene.camera.distortion, IMAGE_SIZE),
        )
        # Both are relative to the noise: the promise's unit is that of the present plan.
        unit = before["fx"] / planned_before(result)["fx"]
        for name, std in promised.items():
            assert found.std[name] == pytest.approx(std * unit, rel=0.15), planned.change
        tried += 1
    assert tried >= 5


def planned_before(result):
    return predicted(result.camera, planes_of(result), result.fixed).std


def test_little_tilt_and_small_squares_are_named():
    def placed(tilt, side):
        camera = squares(0).camera
        guess = ts.Camera(camera.K, camera.distortion, IMAGE_SIZE)
        places = [((330, 300), 20), ((950, 300), 140), ((640, 680), 260)]
        planned = [
            ts.PlannedSquare.at(guess, centre, side, tilt=tilt, direction=direction)
            for centre, direction in places
        ]
        targets = tuple(simulate.Target(p.rotation, p.translation) for p in planned)
        return result_of(simulate.Scene(camera, targets))

    assert "tilted by only" in diagnose(placed(12, 360))["fx"].limits
    assert "tilting every square" in diagnose(placed(12, 360))["fx"].remedy
    small = diagnose(placed(40, 150))["fx"]
    assert "span only 15 to 16 % of the picture's height" in small.limits
    assert "span only" not in str(diagnose(placed(40, 360)))
    assert "1.25 times larger" in small.remedy


@pytest.mark.parametrize("tilt", [30, 45, 60])
def test_what_is_tilted_enough_is_not_to_be_tilted(tilt):
    camera = squares(0).camera
    guess = ts.Camera(camera.K, camera.distortion, IMAGE_SIZE)
    places = [((330, 300), 20), ((950, 300), 140), ((640, 680), 260)]
    planned = [
        ts.PlannedSquare.at(guess, centre, 300, tilt=tilt, direction=direction)
        for centre, direction in places
    ]
    targets = tuple(simulate.Target(p.rotation, p.translation) for p in planned)
    found = diagnose(result_of(simulate.Scene(camera, targets)))
    assert "tilted by only" not in str(found)
    assert ("tilting every square" in str(found)) <= (tilt < 40)


def test_the_cause_that_a_warning_names_comes_first():
    result = result_of(squares(5))
    bent = ts.CalibrationWarning("bent", "correlated_residuals", "low")
    members = {name: getattr(result, name) for name in result.__dataclass_fields__}
    for diagnosis in diagnose(ts.Calibration(**members | {"warnings": (bent,)})).values():
        assert diagnosis.limits.startswith("the samples of a side have a common error")
        assert "correlated_residuals" in diagnosis.remedy
        assert "lower noise" not in diagnosis.remedy
    assert "a warning" not in str(diagnose(result))


def test_of_sides_that_err_together_no_lower_noise_is_advised():
    result = result_of(squares(5))
    members = {name: getattr(result, name) for name in result.__dataclass_fields__}
    together = replace(result.coherence, probability=0.9, displacements=(0.2, 0.1, 0.1))
    for diagnosis in diagnose(ts.Calibration(**members | {"coherence": together})).values():
        assert diagnosis.limits.startswith("the samples of a side have a common error, by 0.2 px")
        assert "lower noise" not in diagnosis.remedy


def test_chessboards_and_planes_that_cannot_be_planned_are_diagnosed():
    result = result_of(squares(4))
    lattice = [
        ts.Plane("chessboard", p.image, p.corners, p.rotation, p.translation, p.rms, p.samples)
        for p in result.planes
    ]
    members = {name: getattr(result, name) for name in result.__dataclass_fields__}
    found = diagnose(ts.Calibration(**members | {"planes": lattice}))
    assert "would reduce it" in found["k2"].remedy
    without = {"planes": lattice[:1], "edges": (), "residuals": ()}
    alone = diagnose(ts.Calibration(**members | without))
    assert alone["fx"].std == result.std["fx"]


def test_a_camera_alone_is_refused():
    with pytest.raises(TypeError, match="calibration must be a Calibration, not Camera"):
        diagnose(result_of(squares(4)).camera)
