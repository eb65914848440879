"""The page on methods of one's own: its example passes the tests that it names, as an installed package would."""

import os
import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "contribute" / "extending.md"


def test_the_example_of_the_page_passes_the_suite(tmp_path):
    blocks = dict(re.findall(r"```(python|toml)\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)[:2])
    tests = re.findall(r"```python\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)[1]
    (tmp_path / "cubic.py").write_text(blocks["python"])
    (tmp_path / "test_cubic.py").write_text(tests)
    info = tmp_path / "cubic-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: cubic\nVersion: 1.0\n")
    head, entry = blocks["toml"].splitlines()
    group = re.fullmatch(r'\[project\.entry-points\."(.*)"\]', head).group(1)
    (info / "entry_points.txt").write_text(f"[{group}]\n{entry.replace(chr(34), '')}\n")
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:dash", "-p", "no:cacheprovider", "test_cubic.py"]
    done = subprocess.run(
        command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"^13 passed", done.stdout, flags=re.MULTILINE), done.stdout
