# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Make live_trial.webp and live_page.png of docs/images: a SIMULATED trial on the live page.

Requires a folder of models, for example from the demo::

    ./tactile demo -o demo
    ./tactile run python docs/moving_picture.py demo/models
"""

from __future__ import annotations

from contextlib import ExitStack
import io
from itertools import pairwise
from pathlib import Path
import sys
import time

from domain_coordinator import domain_id
from PIL import Image

from tactile_bringup.launch_config.graph import ModelChoice, Ports, rig_graph
from tactile_bringup.nodes.graph_runner import ros_context, running_graph
from tactile_lab.watch.access import WatchOptions
from tactile_lab.watch.watching import watching
from tactile_sim.rig_process import SimulatedRig

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / 'src/tactile_lab/test/node'))
from chromium import Chromium  # noqa: E402

PICTURE = ROOT / 'docs/images/live_trial.webp'
PAGE = ROOT / 'docs/images/live_page.png'
SIZE = (1000, 600)
PAGE_SIZE = (1280, 900)
PAUSE_S = 0.12
LABEL = 'T2'


def take_pictures(models: Path) -> list[tuple[float, Image.Image]]:
    """Run a trial on the simulated rig; return times [s] and pictures of the page."""
    pictures: list[tuple[float, Image.Image]] = []
    with ExitStack() as stack:
        domain = stack.enter_context(domain_id())
        rig = stack.enter_context(SimulatedRig(seed=1))
        context = stack.enter_context(ros_context(int(domain)))
        watch = stack.enter_context(
            watching(
                context,
                WatchOptions(),
                simulated=True,
                before_trial=lambda r: rig.mount(r.protocol, r.object_label, r.contact),
            )
        )
        graph = rig_graph(Ports(*rig.ports), ModelChoice.read(models), {}, simulated=True)
        stack.enter_context(running_graph(graph, context, quiet=True))
        browser = stack.enter_context(Chromium(*SIZE))
        browser.open(watch.address)
        browser.wait_for('!document.getElementById("home").hidden')
        browser.evaluate('document.getElementById("home").click()')
        browser.wait_for('document.getElementById("said").innerText.includes("homed")')
        browser.evaluate(
            f'document.getElementById("object").value = "{LABEL}";'
            'document.getElementById("go").click()'
        )
        browser.wait_for('document.querySelector(".phase").textContent === "contact"')
        end_s = None
        while end_s is None or time.monotonic() < end_s:
            picture = Image.open(io.BytesIO(browser.screenshot())).convert('RGB')
            pictures.append((time.monotonic(), picture))
            if end_s is None and browser.evaluate(
                'document.querySelector(".phase").textContent === "done"'
            ):
                end_s = time.monotonic() + 0.5
            time.sleep(PAUSE_S)
        browser.resize(*PAGE_SIZE)
        browser.evaluate('new Promise((drawn) => setTimeout(drawn, 1000))')
        PAGE.write_bytes(browser.screenshot())
    return pictures


def main() -> None:
    """Take the pictures and write them as one animation."""
    pictures = take_pictures(Path(sys.argv[1]))
    times = [at_s for at_s, _ in pictures]
    durations = [round(1000 * (b - a)) for a, b in pairwise(times)]
    images = [image for _, image in pictures]
    images[0].save(
        PICTURE,
        save_all=True,
        append_images=images[1:],
        duration=[*durations, 3000],
        loop=0,
        quality=60,
        method=4,
    )
    print(f'{PICTURE}: {len(images)} pictures, {PICTURE.stat().st_size / 1e6:.2f} MB')  # noqa: T201


if __name__ == '__main__':
    main()
