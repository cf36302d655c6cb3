# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live page for terminals."""

from __future__ import annotations

from collections.abc import Callable
import math

from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from tactile_classifier.records import Outcome
from tactile_lab.watch.answer_text import describe_line
from tactile_lab.watch.finger import Finger
from tactile_lab.watch.state import WatchState

FRAMES_HZ = 8.0
BLOCKS = ' ▁▂▃▄▅▆▇█'
SHOWN_SENTENCES = 8
LEVEL_STYLES = {'ok': 'green', 'warning': 'yellow', 'error': 'red', 'stale': 'red'}


def show_until(state: WatchState, wait: Callable[[float], bool]) -> None:
    """Draw the state again and again until ``wait(seconds)`` returns True."""
    console = Console()
    # Rich redraws only when told: a thread of its own would draw what is not new.
    with Live(console=console, auto_refresh=False, screen=console.is_terminal) as live:
        while not wait(1.0 / FRAMES_HZ):
            live.update(draw(state, console.width), refresh=True)
        live.update(draw(state, console.width), refresh=True)


def draw(state: WatchState, width: int) -> Group:
    """Return what the terminal shows."""
    description = state.describe()
    silences = state.silences()
    parts: list[Panel | Table | Text] = [
        _draw_finger(finger, width - 4, silences.get(finger.name)) for finger in state.fingers
    ]
    if not parts:
        parts.append(
            Text(
                f'Waiting for samples: no finger on {description["where"]}. Start `tactile rig` '
                'or `tactile sense` in another terminal, with the same ROS_DOMAIN_ID.',
                style='yellow',
            )
        )
    if progress := description['progress']:
        parts.append(Text(progress['text'], style='bold'))
    devices = Table.grid(padding=(0, 2))
    for device in description['devices']:
        sentences = [device['message'], *device['missing']]
        style = LEVEL_STYLES[device['level']]
        devices.add_row(Text(device['level'], style=style), device['name'], ' '.join(sentences))
    parts.append(devices)
    said = description['said'][-SHOWN_SENTENCES:]
    styles = {'error': 'red'}
    parts += [Text(line['text'], style=styles.get(line['level'], 'dim')) for line in said]
    return Group(*parts)


def _draw_finger(finger: Finger, width: int, silence_s: float | None) -> Panel:
    columns = max(10, min(100, width))
    _, tensions = finger.points_since(max(0, finger.point_count - 10 * columns))
    event = finger.event
    phase = event.phase if event else 'no trial'
    tension = '' if finger.tension_n is None else f'{finger.tension_n:.2f} N'
    lines = [
        Text(f'{phase:10} {tension:>9}   {finger.rate_hz:g} Hz'),
        Text(sparkline([t for t in tensions if t is not None], columns), style='cyan'),
    ]
    if spectrum := finger.spectrum():
        lines.append(Text(sparkline(spectrum['values'], columns, low=0.0), style='magenta'))
        highest_hz = spectrum['step_hz'] * (len(spectrum['values']) - 1)
        lines.append(Text(f'spectrum, 0 to {highest_hz:g} Hz: {spectrum["part"]}', style='dim'))
    if answered := finger.last_answer():
        answer, _ = answered
        style = 'bold green' if answer.outcome == Outcome.LABEL else 'bold yellow'
        lines.append(Text(describe_line('', *answered), style=style))
    lines += [Text(fault, style='red') for fault in finger.faults()]
    if silence_s is None or silence_s > 1.5:
        since = '' if silence_s is None else f' for {silence_s:.0f} s'
        remedy = 'is the sensor plugged in? `tactile devices` lists what answers.'
        lines.append(Text(f'Waiting for samples{since}: {remedy}', style='red'))
    simulated = ', SIMULATED' if finger.simulated else ''
    return Panel(Group(*lines), title=f'{finger.name or "finger"}{simulated}', width=width + 4)


def sparkline(values: list[float], columns: int, low: float | None = None) -> str:
    """Return a line of blocks, as high as the largest value that each stands for."""
    if not values:
        return ''
    low = min(values) if low is None else low
    height = max(values) - low
    count = min(columns, len(values))
    text = []
    for column in range(count):
        part = values[column * len(values) // count : (column + 1) * len(values) // count]
        share = (max(part) - low) / height if height > 0 else 0.0
        text.append(BLOCKS[min(len(BLOCKS) - 1, max(0, math.ceil(share * (len(BLOCKS) - 1))))])
    return ''.join(text)
