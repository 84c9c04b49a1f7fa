"""Which datagram belongs to which slot, and what is counted."""

from hypothesis import given
from hypothesis import strategies as st

from cosim.live.link import AHEAD, LATE, STALE, Arrivals, Counts


def played(traffic):
    """Runs slots of datagrams (numbers, as bytes); returns the counts and (first, numbers) of each slot."""
    counts = Counts()
    arrivals = Arrivals(counts)
    placed = []
    for slot, numbers in enumerate(traffic):
        first, fresh = arrivals.place(slot, [n.to_bytes(4, "big") for n in numbers])
        placed.append((first, [int.from_bytes(f, "big") for f in fresh]))
    arrivals.close()
    return counts, placed


def test_one_a_slot_is_nothing_to_speak_of() -> None:
    counts, placed = played([[k] for k in range(500)])
    assert counts == Counts(used=500)
    assert placed == [(k, [k]) for k in range(500)]


def test_one_that_never_comes_is_lost() -> None:
    traffic = [[k] for k in range(100)]
    traffic[40] = []
    counts, _ = played(traffic)
    assert counts == Counts(used=99, lost=1, held_over=1)


def test_one_that_comes_a_slot_later_is_late_and_moves_up() -> None:
    counts, placed = played([[0], [], [1, 2], [3]])
    assert counts == Counts(used=4, late=1, held_over=1)
    assert placed[2] == (1, [1, 2])


def test_several_that_a_pause_held_up_are_late() -> None:
    counts, placed = played([[0], *[[]] * 50, [*range(1, 52)], [52]])
    assert counts == Counts(used=53, late=50, held_over=50)
    assert placed[51] == (1, list(range(1, 52)))


def test_what_a_pause_held_up_may_come_in_portions() -> None:
    counts, placed = played(
        [[0], *[[]] * 50, *[[*range(k, k + 10)] for k in range(1, 51, 10)], [51, 52, 53, 54, 55, 56], [57]]
    )
    assert counts == Counts(used=58, late=50, held_over=50)
    assert [first for first, _ in placed[51:57]] == [42, 33, 24, 15, 6, 1]


def test_after_a_late_one_the_next_ones_may_each_come_a_slot_late() -> None:
    """A slot shifted by jitter: 1 comes in slot 2, 2 in slot 3, then 3 and 4 together."""
    counts, placed = played([[0], [], [1], [2], [3, 4], [5]])
    assert counts == Counts(used=6, late=1, held_over=1)
    assert placed[4] == (1, [3, 4])


def test_an_early_one_is_kept_for_its_slot_and_nothing_is_missing() -> None:
    counts, placed = played([[0], [1, 2], [], [3]])
    assert counts == Counts(used=4)
    assert placed[1] == (1, [1, 2])
    assert placed[2] == (2, [])


def test_an_early_one_that_no_empty_slot_follows_was_one_too_many() -> None:
    counts, placed = played([[0], [1, 2], *[[k] for k in range(3, 100)], [], [100]])
    assert counts == Counts(used=100, surplus=1, lost=1, held_over=1)
    assert len(placed) == 101


def test_equal_bytes_beside_another_are_repeated() -> None:
    counts, placed = played([[0], [1], [1, 2], [3, 3], [4]])
    assert counts == Counts(used=5, repeated=2)
    assert [numbers for _, numbers in placed] == [[0], [1], [2], [3], [4]]


def test_equal_bytes_alone_are_a_sample() -> None:
    counts, _ = played([[7]] * 10)
    assert counts == Counts(used=10, identical=9)


def test_of_a_quiet_sender_equal_bytes_after_an_empty_slot_are_late() -> None:
    counts, _ = played([*[[7]] * 10, [], [7, 7], [7]])
    assert counts.late == 1
    assert counts.repeated == counts.lost == 0


def test_a_flood_is_surplus() -> None:
    traffic = [[10 * k + i for i in range(10)] for k in range(100)]
    counts, placed = played(traffic)
    assert counts.used == 100 + AHEAD
    assert counts.surplus == 900 - AHEAD
    assert all(numbers[-1] == 10 * k + 9 for k, (_, numbers) in enumerate(placed)), "the newest counts"


def test_silence_is_an_interruption_and_not_a_hundred_losses() -> None:
    counts, _ = played([[0], *[[]] * 1000, [1], [2]])
    assert counts == Counts(used=3, held_over=1000, silent=1000, interruptions=1)


def test_what_comes_long_after_its_slot_does_not_fill_it() -> None:
    """A loss, and much later two at once: moving all samples between them up would shift them."""
    counts, placed = played([[0], [], *[[k] for k in range(2, 4 + LATE)], [100, 101]])
    assert counts.lost == 1
    assert counts.late == 0
    assert placed[-1][0] == len(placed) - 1


@given(st.lists(st.lists(st.integers(0, 3), max_size=5), max_size=3 * STALE))
def test_every_datagram_is_counted_once_and_every_slot_too(traffic) -> None:
    counts, placed = played(traffic)
    assert counts.used + counts.repeated + counts.surplus == sum(map(len, traffic))
    assert counts.used <= sum(len(numbers) for _, numbers in placed)
    assert counts.held_over == counts.lost + counts.late + counts.silent
    assert all(first <= slot for slot, (first, _) in enumerate(placed))
    assert min(vars(counts).values()) >= 0
