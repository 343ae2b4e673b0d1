"""Lenses of Hugin and lensfun, compared with both programs."""

import re
import shutil
import subprocess

import numpy as np
import pytest
from random_cameras import SIZE, camera_for_hugin, pixel_grid

import trisquare as ts
from trisquare import Camera


def seen_by_hugin(path, pixels):
    """The ideal normalised points at pixels, from the flat panorama made by Hugin."""
    width, height, view = re.search(r"^p f0 w(\d+) h(\d+) v(\d+)", path.read_text(), re.M).groups()
    answer = subprocess.run(
        ["pano_trafo", path, "0"],
        input="".join(f"{x!r} {y!r}\n" for x, y in pixels.tolist()),
        capture_output=True,
        text=True,
        check=True,
    )
    flat = np.array([[float(word) for word in line.split()] for line in answer.stdout.splitlines()])
    centre = np.array([float(width) - 1, float(height) - 1]) / 2
    return (flat - centre) / (0.5 * float(width) / np.tan(np.radians(float(view)) / 2))


@pytest.mark.skipif(shutil.which("pano_trafo") is None, reason="Debian's hugin-tools are not here")
@pytest.mark.parametrize("size", [SIZE, SIZE[::-1]])
def test_hugin_itself_sees_the_same(tmp_path, size):
    path = tmp_path / "lens.pto"
    for seed, model in ((17, "none"), (18, "radial1"), (19, "radial1")):
        camera = camera_for_hugin(seed, model)
        camera = Camera(camera.K, camera.distortion, size, model)
        camera.save(path)
        pixels = pixel_grid(camera)
        ideal = np.c_[seen_by_hugin(path, pixels), np.ones(len(pixels))]
        # Its inverse is iterated, to some thousandth of a pixel.
        assert np.abs(camera.project(ideal) - pixels).max() < 5e-3
    camera = Camera(camera.K, [-0.1, 0.03, 0, 0, 0], size)
    approximation = camera.save(path, approximate=True)
    ideal = np.c_[seen_by_hugin(path, pixels), np.ones(len(pixels))]
    off = np.linalg.norm(camera.project(ideal) - pixels, axis=1)
    assert off.max() < 1.1 * approximation.worst + 5e-3
    assert off.max() > 0.5 * approximation.worst


@pytest.mark.filterwarnings("error")
def test_a_coefficient_that_all_but_vanishes_is_written_to_hugin(tmp_path):
    path = tmp_path / "lens.pto"
    camera = Camera(camera_for_hugin(18, "radial1").K, [1e-320, 0, 0, 0, 0], (640, 480), "radial1")
    camera.save(path)
    np.testing.assert_allclose(Camera.load(path).K, camera.K)


def test_hugins_polynomial_is_the_one_of_its_documentation(tmp_path):
    path = tmp_path / "lens.pto"
    a, b, c, view = 0.011, -0.031, 0.007, 50.0
    path.write_text(
        f'p f2 w3000 h1500 v360 n"TIFF"\ni w1000 h800 f0 v{view} Ra0 Rb0 a{a} b{b} c{c} d5 e-3 '
        'g0 t0 Eev12.5 r0 p0 y0 TrX0 Vm5 n"a b=c.jpg"\n'
        'i w1000 h800 f0 v=0 a=0 b=0 c=0 d=0 e=0 g=0 t=0 r1 p2 y3 n"b.jpg"\n'
    )
    with pytest.raises(
        ts.LensModelError, match="Hugin's a, b, c is not a lens model of trisquare"
    ) as info:
        Camera.load(path)
    pinhole = 500 / np.tan(np.radians(view / 2))
    ideal = np.random.default_rng(2).uniform(-0.35, 0.35, (3000, 2))
    radius = np.linalg.norm(ideal, axis=1) * pinhole / 400
    stretch = a * radius**3 + b * radius**2 + c * radius + 1 - a - b - c
    seen = ideal * pinhole * stretch[:, None] + [499.5 + 5, 399.5 - 3]
    inside = np.all((seen >= 0) & (seen <= [999, 799]), axis=1)
    off = np.linalg.norm(
        info.value.nearest.project(np.c_[ideal, np.ones(3000)])[inside] - seen[inside], axis=1
    )
    assert 0.6 * info.value.worst < off.max() < 1.02 * info.value.worst < 1
    # Without a and c, the model is k1, exactly.
    path.write_text(path.read_text().replace(f"a{a}", "a0").replace(f"c{c}", "c0"))
    camera = Camera.load(path)
    assert camera.model == "radial1"
    stretch = b * radius**2 + 1 - b
    seen = ideal * pinhole * stretch[:, None] + [499.5 + 5, 399.5 - 3]
    np.testing.assert_allclose(camera.project(np.c_[ideal, np.ones(3000)]), seen, atol=1e-10)
    # One of several different lenses must be chosen by name.
    path.write_text(path.read_text().replace("v=0", "v40"))
    with pytest.raises(ValueError, match="2 cameras, 0, 1"):
        Camera.load(path)
    assert Camera.load(path, name="1").fx > camera.fx


def test_lensfuns_lenses_of_one_name_are_told_apart(tmp_path):
    """A database lists a lens once for each sensor size."""
    lens = (
        "<lens><maker>Canon</maker><model>EF 50mm</model><cropfactor>{}</cropfactor><calibration>"
        '<distortion model="poly3" focal="50" k1="-0.01"/></calibration></lens>'
    )
    crops = ("1.0", "1.6", "1.6")
    path = tmp_path / "lenses.xml"
    path.write_text(f"<lensdatabase>{''.join(map(lens.format, crops))}</lensdatabase>")
    with pytest.raises(ValueError, match="there are 3 cameras"):
        Camera.load(path, image_size=SIZE)
    names = ("EF 50mm 50", "EF 50mm 50, Canon at crop 1.6", "EF 50mm 50, Canon at crop 1.6'")
    focal = [Camera.load(path, name=name, image_size=SIZE, approximate=True).fx for name in names]
    np.testing.assert_allclose(focal, np.array([1.0, 1.6, 1.6]) * focal[0], rtol=1e-3)


@pytest.mark.parametrize("size", [SIZE, SIZE[::-1]])
@pytest.mark.parametrize(
    "distortion", [[-0.11, 0, 0, 0, 0], [-0.14, 0.03, 0, 0, 0], [0.1, 0.02, 0, 0, 0.02]]
)
def test_lensfun_itself_sees_the_same(tmp_path, size, distortion):
    lensfunpy = pytest.importorskip("lensfunpy", reason="lensfunpy is not installed")
    camera = camera_for_hugin(20, "none")
    camera = Camera(camera.K, distortion, size, "radial3")
    approximation = camera.save(tmp_path / "lensfun.xml", approximate=True)
    assert (approximation is None) == (distortion[4] == 0)
    database = lensfunpy.Database(
        xml=(tmp_path / "lensfun.xml").read_text(), load_common=False, load_bundled=False
    )
    (lens,) = database.lenses
    width, height = size
    modifier = lensfunpy.Modifier(lens, lens.crop_factor, width, height)
    distortion_only = lensfunpy.ModifyFlags.DISTORTION
    modifier.initialize(lens.min_focal, 8.0, 1000.0, scale=1.0, flags=distortion_only)
    seen = modifier.apply_geometry_distortion().reshape(-1, 2)
    flat = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
    # Its undistorted picture is that of a pinhole with the focal length in the file.
    pinhole = lens.min_focal / np.hypot(36, 24) * np.hypot(width - 1, height - 1)
    ideal = (flat - camera.K[:2, 2]) / pinhole
    inside = np.all((seen >= 0) & (seen <= [width - 1, height - 1]), axis=1)
    assert inside.mean() > 0.5
    off = np.abs(camera.project(np.c_[ideal, np.ones(len(ideal))][inside]) - seen[inside])
    # It accumulates floats of 24 bits along a row.
    single = 0.02
    if approximation is None:
        assert off.max() < single
    else:
        # With SSE, lensfun 0.3.4 computes its ptlens with a noise of up to 0.3 px.
        assert np.sqrt(np.mean(off**2)) < approximation.rms + 0.1
