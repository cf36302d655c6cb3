# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What may move, and what must not. The rules know no IO; `WatchedTopics` feeds them."""
