"""Camera files: a name for each format, and any numbers in one of OpenCV's."""

import cv2

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


def opencv_storage(path, **members):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in members.items():
        storage.write(name, value)
    storage.release()
