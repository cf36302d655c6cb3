#!/bin/sh
# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

# The tests as ROS runs them: each package is collected from its own folder, as `colcon test` does,
# and the one package that is named here is tested whole by `colcon test`.
set -eu
cd "$(dirname "$0")/.."
for tests in src/*/test; do
    package=$(dirname "$tests")
    # Standard error too: a failed collection says there why.
    if ! told=$(cd "$package" && ../../tactile run python -m pytest --collect-only -q 2>&1); then
        printf '%s\n' "$told" "$package: its tests cannot be collected from its folder" >&2
        exit 1
    fi
    printf '%s: %s\n' "$package" "$(printf '%s\n' "$told" | grep 'collected')"
done
base=.tactile/jazzy
./tactile run colcon --log-base "$base/log" test --base-paths src --build-base "$base/build" \
    --install-base "$base/install" --merge-install --packages-select tactile_ros \
    --event-handlers console_direct+ --return-code-on-test-failure
