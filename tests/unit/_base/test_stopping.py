"""Stopping: looks within work, and signals that are noted or end it."""

import signal
import threading

import pytest

from voxgran._base.errors import Interrupted, VoxgranError
from voxgran._base.stopping import Signals, Stopped, stop_if_asked, stopping_when

NUMBERS = (signal.SIGINT, signal.SIGTERM)


def test_work_that_nobody_asks_to_stop_goes_on():
    stop_if_asked()
    with stopping_when(lambda: False):
        stop_if_asked()


def test_work_stops_at_the_first_look_after_it_was_asked():
    asked = [False, False, True]
    with stopping_when(lambda: asked.pop(0)):
        stop_if_asked()
        stop_if_asked()
        with pytest.raises(Stopped):
            stop_if_asked()
    assert not asked
    stop_if_asked()


def test_each_thread_is_asked_alone():
    looked = []

    def work():
        stop_if_asked()
        looked.append(True)

    with stopping_when(lambda: True):
        other = threading.Thread(target=work)
        other.start()
        other.join()
    assert looked == [True]


@pytest.mark.parametrize("number", NUMBERS)
def test_the_first_signal_is_noted_and_the_second_ends_at_once(number):
    before = [signal.getsignal(one) for one in NUMBERS]
    with Signals() as signals:
        signals.patient = True
        signal.raise_signal(number)
        assert signals.number == number
        with pytest.raises(Interrupted, match="at once") as stop:
            signal.raise_signal(signal.SIGTERM)
        assert stop.value.exit_code == 143
        assert signals.number == number
    assert [signal.getsignal(one) for one in NUMBERS] == before


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_at_once_what_has_not_begun(number, status):
    with pytest.raises(Interrupted, match="before the next attempt") as stop, Signals():
        signal.raise_signal(number)
    assert (stop.value.signal_number, stop.value.exit_code) == (number, status)


def test_signals_are_left_alone_outside_of_the_main_thread():
    handlers = []

    def work():
        with Signals():
            handlers.extend(signal.getsignal(one) for one in NUMBERS)

    other = threading.Thread(target=work)
    other.start()
    other.join()
    assert handlers == [signal.getsignal(one) for one in NUMBERS]


def test_an_interrupt_is_no_error_that_is_caught_by_mistake():
    assert not issubclass(Interrupted, (Exception, VoxgranError))
    assert issubclass(Interrupted, KeyboardInterrupt)
    assert not issubclass(Stopped, Exception)
