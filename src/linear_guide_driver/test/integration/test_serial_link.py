# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

import os
import threading

import pytest

from linear_guide_driver.errors import DeviceConnectionError
from linear_guide_driver.serial_link import SerialLink


@pytest.fixture
def make_line():
    """Return a function that creates a link without a reader, and a function to unplug it."""
    links = []

    def make(on_lost):
        ours, theirs = os.openpty()
        link = SerialLink(
            os.ttyname(theirs),
            115_200,
            on_bytes=lambda _: None,
            on_tick=lambda: None,
            on_lost=on_lost,
        )
        links.append(link)
        os.close(theirs)
        return link, lambda: os.close(ours)

    yield make
    for link in links:
        link.close()


def test_a_writer_tells_of_the_loss_before_it_raises_and_reader_and_writer_tell_once(make_line):
    losses = []
    link, unplug = make_line(losses.append)
    unplug()
    with pytest.raises(DeviceConnectionError, match='is lost') as raised:
        link.write(b'?')
    assert losses == [str(raised.value)]
    link.start()
    link._thread.join(5.0)
    with pytest.raises(DeviceConnectionError, match='is lost'):
        link.write(b'?')
    assert len(losses) == 1


def test_a_writer_waits_until_the_reader_has_told(make_line):
    losses = []
    is_telling, may_go_on = threading.Event(), threading.Event()

    def tell(reason):
        is_telling.set()
        may_go_on.wait(5.0)
        losses.append(reason)

    link, unplug = make_line(tell)
    unplug()
    link.start()
    assert is_telling.wait(5.0)
    seen = []

    def write():
        with pytest.raises(DeviceConnectionError):
            link.write(b'?')
        seen.extend(losses)

    writer = threading.Thread(target=write)
    writer.start()
    may_go_on.set()
    writer.join(5.0)
    assert len(seen) == 1
