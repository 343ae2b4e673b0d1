"""A file name for each format, and for each of OpenCV's three."""

FILES = {
    "camera.json": "trisquare",
    "camera.yaml": "opencv",
    "camera.xml": "opencv",
    "opencv.json": "opencv",
    "camera_info.yaml": "ros",
    "camchain.yaml": "kalibr",
    "cameras.txt": "colmap",
    "transforms.json": "nerfstudio",
    "left.cameramodel": "mrcal",
    "lens.pto": "hugin",
    "lensfun.xml": "lensfun",
    "metashape.xml": "metashape",
}
PANORAMA = ("hugin", "lensfun")
