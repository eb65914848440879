#!/usr/bin/env bash
# Build the environment that the Makefile's targets run in: bootstrap.sh [FOLDER, default .venv]
#
# System libraries are probed first, since a missing one shows only when open3d or VTK is loaded. As root on a
# Debian-like system what is missing is installed, otherwise the command that installs it is printed.
set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/.."
venv=${1:-.venv}

say() { printf 'bootstrap: %s\n' "$*"; }
fail() { say "$*" >&2; exit 1; }

# The first Python of at least 3.11 that runs; a pyenv shim may exist and not run.
find_python() {
    local name
    for name in python3 python3.13 python3.12 python3.11; do
        if "$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            command -v "$name"
            return
        fi
    done
    return 1
}

# Debian packages of the system libraries that cannot be loaded, on one line.
missing_libraries() {
    "$1" - <<'PYTHON'
import ctypes
import glob

NEEDED = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libudev.so.1": "libudev1",
    "libidn2.so.0": "libidn2-0",
    "libX11.so.6": "libx11-6",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libgomp.so.1": "libgomp1",
}
SOFTWARE_DRIVERS = (
    "/usr/lib*/dri/*swrast_dri.so",
    "/usr/lib/*/dri/*swrast_dri.so",
    "/usr/lib*/libgallium-*.so",
    "/usr/lib/*/libgallium-*.so",
)


def loads(name):
    try:
        return ctypes.CDLL(name)
    except OSError:
        return None


def has_mesa():
    """Tell whether Mesa can draw without a GPU."""
    return loads("libEGL_mesa.so.0") and any(glob.glob(pattern) for pattern in SOFTWARE_DRIVERS)


def has_other_driver():
    """Tell whether EGL starts without a screen all the same: on the driver of a GPU, say."""
    egl = loads("libEGL.so.1")
    if egl is None or not hasattr(egl, "eglGetPlatformDisplay"):
        return False
    egl.eglGetPlatformDisplay.restype = ctypes.c_void_p
    surfaceless = 0x31DD
    display = egl.eglGetPlatformDisplay(surfaceless, None, None)
    return bool(display and egl.eglInitialize(ctypes.c_void_p(display), None, None))


missing = [package for library, package in NEEDED.items() if not loads(library)]
if not has_mesa() and not has_other_driver():
    missing += ["libegl-mesa0", "libgl1-mesa-dri"]
print(*missing)
PYTHON
}

# Install Debian packages, or say how.
install_packages() {
    if ! command -v apt-get >/dev/null; then
        fail "missing on this system: $* (names of Debian packages); install their like and run this again"
    fi
    if [ "$(id -u)" -ne 0 ]; then
        say "missing on this system: $*; run the next line, then this again" >&2
        printf '%s\n' "sudo apt-get install -y --no-install-recommends $*" >&2
        exit 1
    fi
    say "installing $*"
    apt-get update -q
    DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "$@"
}

# Tell whether the folder holds an environment that can be used as it stands.
is_whole() {
    [ -f "$venv/pyvenv.cfg" ] &&
        "$venv/bin/python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null &&
        { [ -n "$uv" ] || "$venv/bin/python" -m pip --version >/dev/null 2>&1; }
}

# Remove a half-made environment, but never a folder that is something else.
remove_broken() {
    [ -e "$venv" ] || return 0
    if [ ! -f "$venv/pyvenv.cfg" ] && [ -n "$(find "$venv" -type f -print -quit)" ]; then
        fail "$venv is not a virtual environment: it would be replaced; name another folder with VENV="
    fi
    say "$venv is broken: making it anew"
    rm -rf -- "$venv"
}

uv=$(command -v uv || true)

if ! python=$(find_python); then
    install_packages python3 python3-venv
    python=$(find_python) || fail "no Python of at least 3.11 here: install one and run this again"
fi

missing=()
if [ "$(uname -s)" = Linux ]; then
    found=$(missing_libraries "$python")
    read -r -a missing <<<"$found"
fi
if [ -z "$uv" ] && ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
    missing+=("$("$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')")
fi
if [ "${#missing[@]}" -gt 0 ]; then
    install_packages "${missing[@]}"
fi

if ! is_whole; then
    remove_broken
    say "making $venv with $("$python" --version)"
    if [ -n "$uv" ]; then
        "$uv" venv --quiet --python "$python" "$venv"
    else
        "$python" -m venv "$venv"
    fi
fi

# Install into the environment.
install() {
    if [ -n "$uv" ]; then
        "$uv" pip install --quiet --python "$venv/bin/python" "$@"
    else
        "$venv/bin/python" -m pip install --quiet --no-compile --disable-pip-version-check "$@"
    fi
}

# The requirements of pyproject.toml that kernels are compiled with, one a line: all but the large ones.
light_requirements() {
    "$python" - <<'PYTHON'
import re
import tomllib

LARGE = {"open3d", "pyvista", "vtk", "meshio", "plotly", "matplotlib", "contourpy"}
with open("pyproject.toml", "rb") as file:
    project = tomllib.load(file)["project"]
# images of grains are segmented with the latter
needed = project["dependencies"] + [line for line in project["optional-dependencies"]["images"] if "scikit" in line]
print(*(line for line in needed if re.split(r"[^\w-]", line)[0] not in LARGE), sep="\n")
PYTHON
}

say "installing voxgran and what it needs into $venv (about 2 GB, some minutes); the kernels of the demo are compiled meanwhile"
mapfile -t light < <(light_requirements)
install "${light[@]}"
install --no-deps --editable .
"$venv/bin/voxgran" doctor --warm demo &
compiling=$!
trap 'kill "$compiling" 2>/dev/null || true' EXIT
install --editable '.[dev]'
wait "$compiling" || say "kernels are compiled when they are first called"
touch "$venv/.ok"
say "ready"
