# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live page in Chromium, with a simulated rig and real nodes."""

from contextlib import ExitStack, suppress
from dataclasses import replace
import re
import signal
import threading

from chromium import Chromium, find_chromium
from domain_coordinator import domain_id
import numpy as np
import pytest
from tactile_command import program

from tactile_bringup.launch_config.graph import ModelChoice, Ports, rig_graph
from tactile_bringup.nodes.graph_runner import ros_context, running_graph
from tactile_bringup.nodes.operator_node import OperatorNode, StoppedError
from tactile_bringup.trial_protocols import TrialRequest
from tactile_features.types import TrialEvent
from tactile_lab.experiment.live_rig import LiveRig
from tactile_lab.watch.access import WatchOptions
from tactile_lab.watch.finger import Finger
from tactile_lab.watch.server import WatchServer
from tactile_lab.watch.state import WatchState
from tactile_lab.watch.watching import watching
from tactile_ros.errors import TactileError
from tactile_ros.node_group import NodeGroup
from tactile_ros.strain import StrainBlock
from tactile_sim.rig_process import SimulatedRig
from tactile_testing.simulated_rigs import (
    GUARD,
    home_fast,
    let_servos_pause,
    PATIENT,
    truth_at_rest,
)

needs_chromium = pytest.mark.skipif(
    find_chromium() is None, reason='no Chromium is installed; apt install chromium'
)
DEADLINE_S = 30.0
NO_OVERFLOW = 'document.documentElement.scrollWidth <= innerWidth'


@pytest.fixture(scope='module')
def chromium():
    with Chromium() as chromium:
        yield chromium


@pytest.fixture
def browser(chromium):
    """Return a browser with an empty page. The live page of an earlier test would reconnect."""
    chromium.open('about:blank')
    chromium.console.clear()
    return chromium


@pytest.fixture(scope='module')
def rig(trained):
    """Return the simulated rig, the ROS context of its nodes, and a live page."""
    with ExitStack() as stack:
        let_servos_pause(stack.enter_context(pytest.MonkeyPatch.context()))
        context = stack.enter_context(ros_context(int(stack.enter_context(domain_id()))))
        simulated = stack.enter_context(SimulatedRig(seed=3))
        models = ModelChoice.read(trained)
        home_fast(simulated)
        runner = {'approach_speed_m_s': 0.1, **PATIENT}
        quick = {'trial_runner': runner, 'tendon_actuator': GUARD}
        graph = rig_graph(Ports(*simulated.ports), models, quick, simulated=True)
        watch = stack.enter_context(
            watching(
                context,
                WatchOptions(),
                simulated=True,
                before_trial=lambda r: simulated.mount(r.protocol, r.object_label, r.contact),
            )
        )
        stack.enter_context(running_graph(graph, context, quiet=True))
        yield simulated, context, watch


class Recorder:
    """Replaces the bag recorder in a test that records nothing."""

    has_failed = False
    failure = ''
    audits = ()
    window_count = 0


def click(browser, button):
    browser.wait_for(f'(b => b && !b.hidden && !b.disabled)(document.getElementById("{button}"))')
    browser.evaluate(f'document.getElementById("{button}").click()')


def wait_for_text(browser, element, text):
    browser.wait_for(f'document.getElementById("{element}").textContent === {text!r}')


def wait_for_log(browser, text):
    browser.wait_for(f'document.getElementById("said").innerText.includes({text!r})')


def start_trial(browser, protocol, label):
    click(browser, 'trial')
    browser.evaluate(
        f'document.getElementById("protocol").value = "{protocol}";'
        f'document.getElementById("object").value = "{label}"'
    )
    click(browser, 'go')


def text_of(browser, selector):
    return browser.evaluate(f'document.querySelector("{selector}").textContent')


@needs_chromium
def test_page_shows_a_trial_from_contact_to_label(rig, browser):
    """Takes more than 10 s: homing and a complete trial in real time."""
    _, _, watch = rig
    browser.open(watch.address)
    click(browser, 'home')
    wait_for_log(browser, 'homed')
    browser.evaluate(NOTE_PHASES)
    start_trial(browser, 'stiffness', 'none')
    browser.wait_for('/done$/.test(document.querySelector("#said li").innerText)', 60.0)
    browser.wait_for('document.querySelector(".phase").textContent === "done"')
    phases = browser.evaluate('window.phases')
    shown = ['contact', 'hold', 'release']
    assert [phase for phase in phases if phase in shown] == shown
    browser.wait_for('document.querySelector(".label").textContent === "none"')
    assert 'correct' in text_of(browser, '.verdict')
    assert browser.evaluate('document.querySelectorAll(".scores tr").length') == 5
    assert browser.evaluate('document.getElementById("simulated").hidden') is False
    assert 'linear_guide' in browser.evaluate('document.getElementById("devices").innerText')
    # The plot shows the tension and the phases, each in its colour.
    assert browser.evaluate(COLOURS) > 20
    for scheme in ('light', 'dark'):
        browser.set_scheme(scheme)
        for width in (1280, 390):
            browser.resize(width, 844)
            assert browser.evaluate(NO_OVERFLOW)
            assert browser.evaluate(CONTRAST) >= 4.5, f'{scheme}, {width} pixels'
            assert browser.evaluate(STOP_IS_SEEN)
            for selector in ('.label', '.verdict', '.last'):
                assert browser.evaluate(ABOVE_THE_FOLD % selector), f'{selector}, {width} pixels'
    assert text_of(browser, '.last').endswith(': done')
    # The text alternative of the plot of tension is updated less often than the plot.
    browser.wait_for(
        '/; done/.test(document.querySelector("[role=img]").getAttribute("aria-label"))'
    )
    names = browser.evaluate(
        '[...document.querySelectorAll("[role=img]")].map(e => e.getAttribute("aria-label"))'
    )
    assert re.match(r'Tension of the last 10 seconds: now \S+ N, from .* N; done', names[0])
    # For a stiffness trial, the page shows the tension in the hold phase and the fitted line.
    assert re.match(r'Tension in the hold with fitted line: .*, slope \S+ N/s', names[2])
    assert browser.evaluate('document.querySelector(".spectrum-plot").hidden')
    assert 'object none' in text_of(browser, '.about')
    assert set(names[3:]) <= {'ok', 'warning', 'error', 'stale'}
    assert len(names) > 4
    browser.set_scheme('light')
    browser.resize(1280, 900)
    assert browser.console == []


NOTE_PHASES = """(() => { window.phases = []; const phase = document.querySelector('.phase');
  new MutationObserver(() => window.phases.push(phase.textContent))
    .observe(phase, {childList: true, characterData: true, subtree: true}); })()"""

COLOURS = """(() => { const c = document.querySelector('.tension-plot canvas');
  const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data, seen = new Set();
  for (let i = 0; i < d.length; i += 4)
    if (d[i + 3]) seen.add(d[i] << 16 | d[i + 1] << 8 | d[i + 2]);
  return seen.size; })()"""

CONTRAST = """(() => {
  const light = (c) => { const [r, g, b] = c.match(/[\\d.]+/g).map(Number).map((v) => v / 255)
    .map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  const ground = (e) => { while (e) { const c = getComputedStyle(e).backgroundColor;
    if (!/, 0(\\.\\d+)?\\)$/.test(c) && c !== 'rgba(0, 0, 0, 0)') return c; e = e.parentElement; }
    return 'rgb(255, 255, 255)'; };
  let least = 21;
  for (const e of document.querySelectorAll('h1, h2, h3, p, span, b, td, li, time, button')) {
    if (!e.offsetParent || e.disabled || e.closest('.old') || !e.innerText.trim()) continue;
    const [a, b] = [light(getComputedStyle(e).color), light(ground(e))].sort((x, y) => y - x);
    least = Math.min(least, (a + 0.05) / (b + 0.05));
  }
  return least; })()"""
"""JavaScript that returns the smallest contrast between a text and its background on the page.
The accessibility guideline WCAG AA requires at least 4.5."""

ABOVE_THE_FOLD = """(() => { const r = document.querySelector("%s").getBoundingClientRect();
  return scrollY === 0 && r.height > 0 && r.top >= 0
    && r.bottom <= document.getElementById('bar').getBoundingClientRect().top; })()"""
STOP_IS_SEEN = """(() => { const r = document.getElementById('stop').getBoundingClientRect();
  const seen = visualViewport, [x, y] = [r.left + r.width / 2, r.top + r.height / 2];
  return r.top >= seen.offsetTop && r.bottom <= seen.offsetTop + seen.height
    && r.left >= seen.offsetLeft && r.right <= seen.offsetLeft + seen.width
    && r.width >= 160 && r.height >= 55 && document.elementFromPoint(x, y).id === 'stop'; })()"""


@needs_chromium
def test_stop_ends_the_trial_and_brings_guide_and_tendon_to_rest(rig, browser):
    simulated, context, watch = rig
    browser.open(watch.address.split('#')[0])  # without the access token
    browser.wait_for('document.querySelector(".tension")')
    assert browser.evaluate('document.getElementById("home").hidden')
    operator = OperatorNode(context)
    with NodeGroup([operator], context):
        operator.home_guide()
        simulated.mount('texture', 'R1', 'flexion')
        request = TrialRequest('texture', 'flexion', 'R1', 'first')
        stopped = []
        live = LiveRig(operator, Recorder(), None)

        def attempt(trial_id):
            try:
                live.run(replace(request, trial_id=trial_id))
            except StoppedError as error:
                stopped.append(str(error))

        def run():
            with suppress(TactileError):
                attempt('first')
                return
            attempt('second')  # reached only if the first trial failed on a busy computer

        thread = threading.Thread(target=run)
        thread.start()
        browser.wait_for('document.querySelector(".phase").textContent === "glide"')
        click(browser, 'stop')
        browser.wait_for('document.querySelector(".phase").textContent === "aborted"')
        thread.join(DEADLINE_S)
        wait_for_log(browser, 'stop: confirmed by')
        said = text_of(browser, '#outcome').lower().removeprefix('stop: confirmed by ').split(', ')
        assert sorted(said) == ['linear_guide', 'operator', 'tendon_actuator', 'trial_runner']
        assert text_of(browser, '.last.error').startswith('trial aborted: ')
        assert browser.evaluate(STOP_IS_SEEN)
    assert len(stopped) == 1  # `StoppedError` was raised
    assert watch.state.was_stopped
    assert abs(truth_at_rest(simulated)['tendon_displacement_m']) < 1e-3, 'the tendon is slackened'
    assert browser.console == []


@needs_chromium
def test_page_shows_why_the_rig_is_stopped_until_reset(rig, browser):
    _, context, watch = rig
    browser.open(watch.address.split('#')[0])  # without the access token
    browser.wait_for('document.querySelector(".tension")')
    click(browser, 'stop')
    browser.wait_for('!document.getElementById("stopped").hidden')
    assert browser.evaluate('document.getElementById("reset").hidden')
    assert browser.evaluate('document.getElementById("release").hidden')
    browser.open('about:blank')
    browser.open(watch.address)
    browser.wait_for('!document.getElementById("stopped").hidden')
    assert re.fullmatch(
        r'Stopped: Stop was pressed on /\w+\. Guides do not move .* until Reset\.',
        text_of(browser, '#stopped'),
    )
    for scheme in ('light', 'dark'):
        browser.set_scheme(scheme)
        for size in ((1280, 900), (390, 844), (844, 390)):
            browser.resize(*size)
            assert browser.evaluate(NO_OVERFLOW), size
            assert browser.evaluate(STOP_IS_SEEN), size
            assert browser.evaluate(CONTRAST) >= 4.5, size
    browser.set_scheme('light')
    browser.resize(1280, 900)
    start_trial(browser, 'stiffness', 'none')
    wait_for_log(browser, 'The rig is stopped: Stop was pressed')
    click(browser, 'release')
    wait_for_log(browser, 'release: done by tendon_actuator')
    press(browser, 'reset')
    wait_for_log(browser, 'reset: done by')
    browser.wait_for('document.getElementById("stopped").hidden')
    browser.wait_for('document.getElementById("reset").disabled')
    operator = OperatorNode(context)
    with NodeGroup([operator], context):
        operator.home_guide()  # the guide can move after the reset
    assert browser.console == []


@needs_chromium
def test_page_without_fingers_shows_instructions_and_a_lost_connection(context, browser):
    with watching(context, WatchOptions()) as watch:
        browser.open(watch.address)
        browser.wait_for('document.getElementById("where").textContent.includes("ROS domain")')
        text = browser.evaluate('document.querySelector("main").innerText')
        assert 'Waiting for samples' in text
        assert f'ROS domain {context.get_domain_id()}' in text
        assert browser.console == []
    browser.wait_for('!document.getElementById("cut").hidden')
    assert browser.evaluate(STOP_IS_SEEN)
    click(browser, 'stop')
    assert 'not sent' in text_of(browser, '#outcome')


class StoppableRig:
    """Replaces `WatchControls`, confirms every command and counts the stops."""

    def __init__(self):
        self.stops = 0

    async def stop(self):
        self.stops += 1
        return f'stop: confirmed by rig {self.stops}'

    async def release(self):
        return 'release: done by rig'

    async def reset(self):
        return 'reset: done by rig'


def press(browser, element):
    """Click at the position of an element; an element that covers it receives the click."""
    x, y = browser.evaluate(
        f'(r => [r.left + r.width / 2, r.top + r.height / 2])'
        f'(document.getElementById("{element}").getBoundingClientRect())'
    )
    button = {'x': x, 'y': y, 'button': 'left', 'clickCount': 1}
    for kind in ('mousePressed', 'mouseReleased'):
        browser.call('Input.dispatchMouseEvent', type=kind, **button)


def press_key(browser, key):
    for kind in ('keyDown', 'keyUp'):
        browser.call('Input.dispatchKeyEvent', type=kind, key=key, code=key)


@needs_chromium
def test_stop_can_be_pressed_while_a_trial_is_being_chosen(browser):
    state, controls = WatchState(), StoppableRig()
    state.finger('index')
    state.set_controls('index', ['tare', 'home', 'trial'])
    is_open = 'document.getElementById("ask").open'
    with WatchServer(state, controls) as server:
        browser.open(server.address)
        browser.wait_for('document.querySelector(".answer")')
        assert browser.evaluate('document.querySelector(".answer").hidden')
        for number, (width, height) in enumerate(((1280, 900), (390, 844), (844, 390)), 1):
            browser.resize(width, height)
            click(browser, 'trial')
            assert browser.evaluate(is_open)
            browser.evaluate('document.getElementById("object").focus()')
            assert browser.evaluate(STOP_IS_SEEN), f'{width} x {height}'
            assert browser.evaluate(NO_OVERFLOW), f'{width} x {height}'
            press(browser, 'stop') if number < 3 else press_key(browser, 'Escape')
            wait_for_text(browser, 'outcome', f'Stop: confirmed by rig {number}')
            assert not browser.evaluate(is_open)
        assert controls.stops == 3
        browser.resize(390, 844)
        click(browser, 'trial')
        browser.call('Emulation.setPageScaleFactor', pageScaleFactor=2)
        browser.wait_for('visualViewport.scale > 1.9')
        browser.wait_for(STOP_IS_SEEN)
        browser.call('Emulation.setPageScaleFactor', pageScaleFactor=1)
    # The server has ended after a confirmed stop. Only one of two elements shows a message.
    browser.wait_for('document.body.classList.contains("off")')
    assert browser.evaluate(
        'document.getElementById("cut").hidden !== document.getElementById("outcome").hidden'
    )
    assert 'switch of the rig' in browser.evaluate('document.getElementById("bar").innerText')
    browser.resize(1280, 900)


@needs_chromium
def test_a_stiffness_finger_shows_its_hold_and_its_object_without_models(browser):
    state, period_ns = WatchState(), 16_666_667
    time_s = np.arange(420) * period_ns * 1e-9
    tension_n = np.where(time_s < 2.0, 1.5 * time_s, 3.0 - 0.2 * (time_s - 2.0))
    state.update('index', Finger.take_block, StrainBlock(10**18, 0, period_ns, tension_n))
    for second, phase in ((0, 'contact'), (2, 'hold')):
        stamp_ns = 10**18 + second * 10**9
        event = TrialEvent(stamp_ns, 't1', 'monday', 'stiffness', 'flexion', 'sponge', phase)
        state.update('index', Finger.take_event, event)
    with WatchServer(state, StoppableRig()) as server:
        browser.open(server.address)
        browser.wait_for('document.querySelector(".hold-plot")')
        browser.wait_for('!document.querySelector(".hold-plot").hidden')
        assert browser.evaluate('document.querySelector(".spectrum-plot").hidden')
        assert browser.evaluate('document.querySelector(".answer").hidden')
        label = 'document.querySelector(".hold-plot").getAttribute("aria-label")'
        browser.wait_for(f'({label} || "").includes("slope -0.2 N/s")')
        about = text_of(browser, '.about')
        for name in ('object sponge', 'session monday', 'trial t1'):
            assert name in about
        # The pixels are read only once, because Chromium logs a warning when they are read again.
        assert browser.evaluate(COLOURS.replace('.tension-plot', '.hold-plot')) > 20
        for width in (1280, 390):
            browser.resize(width, 844)
            assert browser.evaluate(NO_OVERFLOW)
        browser.resize(1280, 900)
        # In the glide phase of a texture trial, the page shows the spectrum again.
        glide = TrialEvent(10**18 + 7 * 10**9, 't2', '', 'texture', 'flexion', '', 'glide')
        state.update('index', Finger.take_event, glide)
        after = StrainBlock(10**18 + 420 * period_ns, 420, period_ns, np.ones(60))
        state.update('index', Finger.take_block, after)
        browser.wait_for('document.querySelector(".hold-plot").hidden')
    assert browser.console == []


@needs_chromium
def test_a_frozen_server_is_not_connected_and_a_stop_not_confirmed(browser):
    with program('watch') as process:
        address = re.search(r'http://\S+', process.stdout.readline()).group()
        browser.open(address)
        browser.wait_for('document.getElementById("link").classList.contains("on")')
        process.send_signal(signal.SIGSTOP)
        click(browser, 'stop')
        assert 'not confirmed yet' in text_of(browser, '#outcome')
        browser.wait_for('!document.getElementById("cut").hidden')
        assert text_of(browser, '#link span') == 'not connected'
        wait_for_text(browser, 'outcome', 'Stop is not confirmed. Use the switch of the rig.')
        assert browser.evaluate(STOP_IS_SEEN)
        assert browser.evaluate('document.getElementById("home").disabled')
        process.send_signal(signal.SIGCONT)
        browser.wait_for('document.getElementById("cut").hidden')
        wait_for_log(browser, 'stop: no node was found')
        assert 'no node was found' in text_of(browser, '#outcome')
