"""The lens model chosen by evidence: the choice, its report, and what is kept and refused."""

import json

import numpy as np
import pytest
from scenes import IMAGE_SIZE, assert_within, edges_of, squares

import trisquare as ts
from trisquare import simulate
from trisquare.results.model_alternative import evidence_text
from trisquare.simulate.scene import TrueCamera

# k1, k2, p1, p2, k3, each far beyond its standard deviation in the scenes below.
LENSES = {
    "none": [0, 0, 0, 0, 0],
    "radial1": [-0.2, 0, 0, 0, 0],
    "radial2": [-0.25, 0.2, 0, 0, 0],
    "radial3": [-0.1, 0.5, 0, 0, -0.6],
    "brown": [-0.15, 0, 0.004, -0.004, 0],
}

FISHEYES = ("equidistant", "fisheye1", "fisheye2", "fisheye")


def scene_of(model, seed=5):
    camera = TrueCamera(1000.0, 1003.0, 648.0, 473.0, LENSES[model], IMAGE_SIZE)
    return squares(seed, camera=camera)


@pytest.mark.parametrize("model", LENSES)
def test_the_lens_is_recognised(model):
    scene = scene_of(model)
    result = ts.calibrate_edges(edges_of(scene, noise=0.03, seed=2), IMAGE_SIZE, model="auto")
    assert result.camera.model == model
    assert set(result.alternatives)
    # Of the fisheye models, only the best is listed.
    assert {a.model for a in result.alternatives} < {*LENSES, *FISHEYES}
    assert model not in {a.model for a in result.alternatives}
    assert all(a.log_evidence <= 0 < a.rms for a in result.alternatives)
    assert_within(result, scene, 4)


@pytest.mark.parametrize("seed", range(4))
def test_a_likely_fisheye_speaks_for_its_family(seed):
    rng = np.random.default_rng(seed)
    edges = [bent(figure, rng) for figure in edges_of(scene_of("radial1"), noise=0.1, seed=seed)]
    result = ts.calibrate_edges(edges, IMAGE_SIZE, model="auto")
    (fisheye,) = (a for a in result.alternatives if a.model in FISHEYES)
    # With four coefficients in a narrow field, k4 may be -260 as well as 0.
    assert fisheye.log_evidence > -100.0


def bent(figure, rng, size=0.3):
    """Bend each side as an uneven sheet does."""
    sides = []
    for side in figure.points:
        along = side[-1] - side[0]
        place = (side - side[0]) @ along / (along @ along)
        across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        height = rng.normal(0.0, size) * place * (1.0 - place) + rng.normal(0.0, size) * place
        sides.append(side + np.outer(4.0 * height, across))
    return ts.PlaneEdges.square(sides)


def test_models_that_would_do_as_well_are_said():
    odds = {"none": -2.5e7, "radial2": -0.98, "radial3": -1.02, "brown": 0.0}
    others = tuple(ts.ModelAlternative(name, value, 0.1) for name, value in odds.items())
    said = (
        "by evidence (natural log odds of the other models against it: none below -100, "
        "radial2 -1.0, radial3 -1.0, brown 0.0; the models radial2 and brown would do as well)"
    )
    assert evidence_text(others) == said
    clear = evidence_text(others[:1])
    assert clear == "by evidence (natural log odds of the other models against it: none below -100)"
    assert evidence_text(()) == ""


def test_the_rejected_models_survive_json_and_pickle():
    result = ts.calibrate_edges(edges_of(scene_of("radial1"), 0.2), IMAGE_SIZE, model="auto")
    again = ts.Calibration.from_json(result.to_json())
    assert again.alternatives == result.alternatives != ()
    members = json.loads(result.to_json())
    assert set(members["alternatives"][0]) == {"model", "log_evidence", "rms_px"}
    # The format before there was a choice.
    del members["alternatives"]
    assert ts.Calibration.from_json(json.dumps(members)).alternatives == ()
    members["alternatives"] = [{"model": "radial1", "log_evidence": 1.0, "rms_px": 0.1}]
    with pytest.raises(ValueError, match="log_evidence"):
        ts.Calibration.from_json(json.dumps(members))


def test_a_named_model_rejects_none():
    assert ts.calibrate_edges(edges_of(scene_of("none"), 0.2), IMAGE_SIZE).alternatives == ()


def test_doubt_about_the_model_widens_the_intervals():
    edges = edges_of(scene_of("radial1"), noise=0.4)
    auto = ts.calibrate_edges(edges, IMAGE_SIZE, model="auto")
    plain = ts.calibrate_edges(edges, IMAGE_SIZE, model=auto.camera.model)
    assert np.array_equal(auto.camera.K, plain.camera.K)
    assert all(auto.std[name] > plain.std[name] for name in plain.std)


def test_pixels_are_fitted_with_the_chosen_model():
    scene = scene_of("radial1")
    image = simulate.render(scene, np.random.default_rng(3), noise=2.0, blur=0.8, tone="srgb")
    result = ts.calibrate(image, model="auto")
    assert (result.camera.model, result.stage) == ("radial1", "pixels")
    assert_within(result, scene, 4)


@pytest.mark.parametrize("options", [{"method": "linear"}, {"fix": "distortion"}])
def test_nothing_to_choose_is_an_error(options):
    with pytest.raises(ValueError, match="auto"):
        ts.calibrate_edges(edges_of(scene_of("none")), IMAGE_SIZE, model="auto", **options)


def test_too_few_planes_are_told_as_ever():
    with pytest.raises(ts.NotEnoughPlanesError):
        ts.calibrate_edges(edges_of(scene_of("none"))[:1], IMAGE_SIZE, model="auto")
