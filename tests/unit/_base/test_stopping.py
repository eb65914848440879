"""Stopping: looks within work, and signals that are noted or end it."""

import signal
import threading

import pytest

from voxgran._base.errors import Interrupted, VoxgranError
from voxgran._base.files import write_text, written_whole
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran._base.stopping import Signals, Stopped, heed, stop_if_asked, stopping_when

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
def test_a_signal_ends_what_has_not_begun_at_the_next_look(number, status, tmp_path):
    looks = (heed, stop_if_asked, lambda: kernel(looks)(), lambda: load("json"), lambda: write_text(tmp_path / "a", ""))
    for look in looks:
        with Signals() as signals:
            # nothing is raised where the signal arrives
            signal.raise_signal(number)
            assert signals.number == number
            with pytest.raises(Interrupted, match="before the next attempt") as stop:
                look()
            assert (stop.value.signal_number, stop.value.exit_code) == (number, status)
            # the work ends, and may write what it leaves
            write_text(tmp_path / "left", "")
    assert [path.name for path in tmp_path.iterdir()] == ["left"]


def test_a_signal_that_was_not_heeded_is_heeded_outside():
    with Signals() as outer:
        with Signals() as inner:
            inner.patient = True
            signal.raise_signal(signal.SIGINT)
            heed()
        assert outer.number == signal.SIGINT
        with pytest.raises(Interrupted):
            heed()
    with Signals() as outer:
        with pytest.raises(Interrupted), Signals():  # noqa: PT012
            signal.raise_signal(signal.SIGINT)
            heed()
        # it was heeded within
        heed()
        assert outer.number == signal.SIGINT
    heed()


@pytest.mark.parametrize("patient", [False, True])
def test_a_signal_that_came_before_is_known_within(patient):
    with Signals() as outer:
        outer.patient = patient
        signal.raise_signal(signal.SIGTERM)
        with Signals() as inner:
            # who is patient sees it by itself
            assert inner.number == (0 if patient else signal.SIGTERM)


def test_what_is_to_be_undone_is_known_as_long_as_it_is_there(tmp_path):
    with Signals() as outer, Signals():
        with written_whole(tmp_path / "a") as draft:
            draft.write_text("half")
            (undo,) = outer.undo.values()
            undo()
            assert not draft.exists()
            draft.write_text("whole")
        assert not outer.undo
    assert (tmp_path / "a").read_text() == "whole"


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
