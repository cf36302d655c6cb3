#!/bin/sh
# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

# The tests of units and analyses of the plain Python cores, in the Python that is on the path, without ROS.
set -eu
cd "$(dirname "$0")/.."
PYTHONPATH=$(printf '%s:' "$PWD"/src/*/)
export PYTHONPATH
for package in linear_guide_driver tactile_classifier tactile_features tactile_sim tendon_sensor_driver; do
    echo "$package"
    (cd "src/$package" && python -m pytest -q -p no:cacheprovider test/unit $(ls -d test/analysis 2> /dev/null))
done
