"""A batch on the processes of MPI."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from batches import make_pictures

MPIEXEC = Path(sys.executable).parent / "mpiexec"


@pytest.mark.slow
@pytest.mark.skipif(not MPIEXEC.exists(), reason="needs MPI")
def test_a_folder_of_pictures(tmp_path):
    pytest.importorskip("mpi4py")
    make_pictures(tmp_path / "in", [f"cam{number}.png" for number in range(6)])
    (tmp_path / "in" / "bad.png").write_text("no picture")
    batch = (sys.executable, "-m", "mpi4py.futures", "-m", "trisquare", "batch", "in", "-o", "out")
    done = subprocess.run(
        [MPIEXEC, "-n", "3", *batch, "--mpi", "--json"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 6, done.stderr
    answer = json.loads(done.stdout)
    assert (answer["passed"], answer["failed"]) == (6, 1)
    assert len(list((tmp_path / "out" / "cameras").iterdir())) == 6
