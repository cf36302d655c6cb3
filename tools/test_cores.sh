#!/bin/sh
# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

# The tests of units and analyses of the plain Python cores, without ROS, by a Python that has
# requirements/cores.txt: test_cores.sh [PYTHON].
set -eu
python=${1:-python}
cd "$(dirname "$0")/.."
PYTHONPATH=$(printf '%s:' "$PWD"/src/*/)
export PYTHONPATH
for package in linear_guide_driver tactile_analysis tactile_classifier tactile_features tactile_sim tendon_sensor_driver; do
    echo "$package"
    (cd "src/$package" && "$python" -m pytest -q -p no:cacheprovider test/unit $(ls -d test/analysis 2> /dev/null))
done
