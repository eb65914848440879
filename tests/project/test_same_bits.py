"""The rule of `make lint` that finds what depends on the processor."""

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).parents[2] / "tools" / "same_bits.py"

FOUND = {
    "a @ b": "@",
    "np.matmul(a, b)": "np.matmul",
    "a.dot(b)": "dot",
    "np.einsum('i,i', a, b)": "np.einsum",
    "np.linalg.norm(a)": "np.linalg",
    "np.polynomial.legendre.leggauss(3)": "np.polynomial",
    "np.exp(a)": "np.exp",
    "np.power(a, 3)": "np.power",
    "np.abs(a) ** 3": "** of an array",
    "np.argsort(a)": "argsort without kind='stable'",
    "a.argsort(axis=1)": "argsort without kind='stable'",
    "np.argpartition(a, 3)": "argpartition",
    "load('scipy.linalg').eigh(a)": "scipy.linalg",
    "load('scipy.ndimage').gaussian_filter(a, 2)": "gaussian_filter",
}
LEFT_ALONE = (
    "linear.matmul(a, b)",
    "np.argsort(a, kind='stable')",
    "np.abs(a) ** 2",
    "math.exp(2.0)",
    "2.0**a",
    "a @ b  # bits: sparse",
)


def looked_at(folder):
    return subprocess.run([sys.executable, str(PROGRAM), str(folder)], check=False, capture_output=True, text=True)


@pytest.mark.parametrize("code", FOUND)
def test_what_depends_on_the_processor_is_found(code, tmp_path):
    (tmp_path / "room.py").write_text(f"def f(a, b):\n    return {code}\n")
    ended = looked_at(tmp_path)
    assert ended.returncode == 1
    assert f"room.py:2: {FOUND[code]} depends on the processor" in ended.stdout


def test_exceptions_kernels_and_pictures_are_left_alone(tmp_path):
    (tmp_path / "room.py").write_text("".join(f"def f(a, b):\n    return {code}\n" for code in LEFT_ALONE))
    (tmp_path / "kernels.py").write_text("@bare_kernel\ndef f(a):\n    return np.sin(a)\n")
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "plots.py").write_text("line = np.polyfit(x, y, 1)\n")
    assert looked_at(tmp_path).returncode == 0


def test_the_package_has_no_such_call():
    ended = looked_at(PROGRAM.parents[1] / "voxgran")
    assert (ended.returncode, ended.stdout) == (0, "")
