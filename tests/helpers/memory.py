"""Memory use of a statement, as reported by Linux."""

import subprocess
import sys

SCRIPT = """
import resource, sys, cv2, trisquare as ts
from trisquare.images.video import Video
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    {}
except ts.ImageError as error:
    print(error, file=sys.stderr)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


def growth(statement, path):
    """Return the growth in kilobytes of a new process's peak memory by a statement, and its errors.

    The statement has the path as ``sys.argv[1]``.
    """
    command = [sys.executable, "-c", SCRIPT.format(statement), path]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return int(done.stdout), done.stderr
