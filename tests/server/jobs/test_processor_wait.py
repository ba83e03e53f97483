"""Processor wait: a fold that other work slows down is told from one that takes long."""

import os

from foldback.server.jobs.processor_wait import ProcessorWait, waited_s


def test_computer_is_busy_while_the_process_waits_much_of_the_time() -> None:
    now, waited = 0.0, 0.0
    measured = ProcessorWait(lambda pid: waited, clock=lambda: now)
    assert not measured.busy(1)
    wait_flags: list[bool] = []
    for wait_s in (0.0, 0.5, 1.5, 1.9, 0.1):
        now, waited = now + 2.0, waited + wait_s
        wait_flags.append(measured.busy(1))
    assert wait_flags == [False, False, True, True, False]
    now, waited = now + 0.1, waited + 0.1  # too short to be judged
    assert not measured.busy(1)
    now, waited = now + 3.0, waited + 3.0
    assert not measured.busy(2)  # another process begins
    assert not ProcessorWait(lambda pid: None).busy(1)


def test_wait_of_a_process_is_known() -> None:
    own_wait_s = waited_s(os.getpid())
    assert own_wait_s is not None and own_wait_s >= 0.0
    assert waited_s(2**22 + 1) is None
