from threading import Thread

import flint

from gsp.algebra.precision import precision


def test_precision_is_set_by_one_thread_at_a_time_and_restored() -> None:
    before = flint.ctx.prec
    seen: list[int] = []

    def other() -> None:
        with precision(200):
            seen.append(flint.ctx.prec)

    with precision(64):
        thread = Thread(target=other)
        thread.start()
        thread.join(0.2)
        assert not seen
        assert flint.ctx.prec == 64
        with precision(100):
            assert flint.ctx.prec == 100
        assert flint.ctx.prec == 64
    thread.join()
    assert seen == [200]
    assert flint.ctx.prec == before
