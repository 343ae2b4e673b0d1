"""Camera files of Metashape."""

import numpy as np
import pytest
from random_cameras import assert_same, saved

import trisquare as ts
from trisquare import Camera
from trisquare.formats import load_camera

METASHAPE_FILE = """\
<?xml version="1.0" encoding="UTF-8"?>
<calibration>
  <projection>{projection}</projection>
  <width>1920</width>
  <height>1080</height>
  <f>1430.15016509976</f>
  <cx>-24.1342060175983</cx>
  <cy>17.5452248329602</cy>
  <b1>1.5</b1>
  <b2>-4.25145544487403</b2>
  <k1>-0.118322055927498</k1>
  <k2>0.293632083518507</k2>
  {further}
  <date>2017-11-14T23:30:12Z</date>
</calibration>
"""


METASHAPE_CAMERA = {
    **{"f": 1430.15016509976, "cx": -24.1342060175983, "cy": 17.5452248329602},
    **{"b1": 1.5, "b2": -4.25145544487403, "k1": -0.118322055927498, "k2": 0.293632083518507},
}


def projected_by_metashape(points, projection, **numbers):
    """Pixels by "Camera models" of its manual; (0, 0) is the corner of the first one."""
    v = dict.fromkeys(("k1", "k2", "k3", "k4", "p1", "p2"), 0.0) | METASHAPE_CAMERA | numbers
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    if projection == "fisheye":
        r = np.hypot(x, y)
        x, y = x * np.arctan(r) / r, y * np.arctan(r) / r
    r2 = x * x + y * y
    radial = 1 + r2 * (v["k1"] + r2 * (v["k2"] + r2 * (v["k3"] + r2 * v["k4"])))
    dx = x * radial + v["p1"] * (r2 + 2 * x * x) + 2 * v["p2"] * x * y
    dy = y * radial + v["p2"] * (r2 + 2 * y * y) + 2 * v["p1"] * x * y
    u = 1920 * 0.5 + v["cx"] + dx * v["f"] + dx * v["b1"] + dy * v["b2"]
    return np.column_stack([u, 1080 * 0.5 + v["cy"] + dy * v["f"]])


@pytest.mark.parametrize(
    ("projection", "model", "further"),
    [
        ("frame", "radial2", {}),
        ("frame", "brown", {"k3": -0.05, "p1": 0.000330080086304322, "p2": 0.00182154893322038}),
        ("fisheye", "fisheye2", {}),
        ("fisheye", "fisheye", {"k3": -0.02, "k4": 0.001}),
    ],
)
def test_metashape_s_cameras_are_what_its_manual_says(tmp_path, projection, model, further):
    lines = "".join(f"<{key}>{value}</{key}>" for key, value in further.items())
    path = tmp_path / "sensor.xml"
    path.write_text(METASHAPE_FILE.format(projection=projection, further=lines))
    loaded = load_camera(path)
    camera = loaded.camera
    assert (loaded.format, camera.model, camera.image_size) == ("metashape", model, (1920, 1080))
    assert camera.skew == METASHAPE_CAMERA["b2"]
    points = np.array([[0.3, 0.2, 1.0], [-0.5, 0.1, 1.0], [0.6, -0.3, 1.0]])
    theirs = projected_by_metashape(points, projection, **further)
    np.testing.assert_allclose(camera.project(points) + 0.5, theirs, atol=1e-9)
    # The written camera is the one that was read, up to the last digit of the principal point.
    again = Camera.load(saved(camera, tmp_path / "metashape.xml"))
    assert_same(again, camera, tolerance=2.3e-13)
    assert again.model == camera.model


METASHAPE_EXPORT = """\
<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0">
  <chunk label="Chunk 1" enabled="true">
    <sensors next_id="1">{sensors}
    </sensors>
    <cameras next_id="1" next_group_id="0">
      <camera id="0" sensor_id="0" component_id="0" label="DJI_0001">
        <transform>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</transform>
      </camera>
    </cameras>
  </chunk>
</document>
"""


METASHAPE_SENSOR = """
      <sensor id="{number}" label="{label}" type="frame">
        <resolution width="1920" height="1080"/>
        <property name="focal_length" value="10.26"/>
        <calibration type="frame" class="initial">
          <resolution width="1920" height="1080"/>
          <f>1400</f>
        </calibration>
        <calibration type="frame" class="{kind}">
          <resolution width="1920" height="1080"/>
          <f>{f}</f>
          <cx>-24.125</cx>
          <k1>-0.0625</k1>
          <p1>0.00390625</p1>
        </calibration>
      </sensor>"""


def exported_by_metashape(path, *labels, kind="adjusted"):
    sensors = "".join(
        METASHAPE_SENSOR.format(number=number, label=label, kind=kind, f=1430.5 + number)
        for number, label in enumerate(labels)
    )
    path.write_text(METASHAPE_EXPORT.format(sensors=sensors))
    return path


def test_sensors_of_metashape_s_exported_cameras_are_read(tmp_path):
    path = exported_by_metashape(tmp_path / "cameras.xml", "FC6310")
    loaded = load_camera(path)
    camera = loaded.camera
    assert (loaded.format, camera.image_size) == ("metashape", (1920, 1080))
    assert (camera.fx, camera.cx, camera.cy) == (1430.5, 959.5 - 24.125, 539.5)
    np.testing.assert_array_equal(camera.distortion, [-0.0625, 0, 0, 0.00390625, 0])

    exported_by_metashape(path, "wide", "tele (24mm)")
    with pytest.raises(ValueError, match=r"wide.*tele \(24mm\)"):
        Camera.load(path)
    assert Camera.load(path, name="tele (24mm)").fx == 1431.5
    exported_by_metashape(path, "FC6310", "FC6310")
    assert Camera.load(path, name="sensor 1").fx == 1431.5


def test_exported_cameras_without_a_calibration_are_refused(tmp_path):
    path = exported_by_metashape(tmp_path / "cameras.xml", "FC6310", kind="other")
    with pytest.raises(ValueError, match="'FC6310' has no adjusted calibration: align its"):
        Camera.load(path)
    exported_by_metashape(path)
    with pytest.raises(ValueError, match="no sensor: export the cameras, File > Export"):
        Camera.load(path)


def test_a_frame_of_metashape_s_with_k4_is_read_as_the_nearest(tmp_path):
    path = tmp_path / "sensor.xml"
    text = METASHAPE_FILE.format(projection="frame", further="<k4>0.004</k4><p1>0.001</p1>")
    path.write_text(text)
    with pytest.raises(ValueError, match='"k4" and "b2" are not read together'):
        Camera.load(path)
    path.write_text(text.replace("<b2>-4.25145544487403</b2>", ""))
    named = "Metashape's frame with k4 is not a lens model of"
    with pytest.raises(ts.LensModelError, match=named) as info:
        Camera.load(path)
    camera = Camera.load(path, approximate=True)
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-0.8, 0.8, (9000, 2)), np.ones(9000)])
    seen = projected_by_metashape(points, "frame", b2=0.0, k4=0.004, p1=0.001) - 0.5
    inside = np.all((seen >= 0) & (seen <= [1919, 1079]), axis=1)
    off = np.linalg.norm(camera.project(points[inside]) - seen[inside], axis=1)
    assert 0.5 * info.value.worst < off.max() < 1.01 * info.value.worst
