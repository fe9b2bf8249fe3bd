from traverse.fleet.member_name import LOSSES, LOSSES_S, NameConflict


def test_the_second_of_a_name_gives_way_and_the_first_stays():
    first, second = NameConflict(0.0), NameConflict(50.0)
    assert not first.shows(50.0)
    now_s, n_taken_over = 50.0, 1
    while True:  # each throws the other one out
        now_s += 0.2
        first.connected_s = now_s
        n_taken_over += 1
        if second.shows(now_s):
            break
        second.connected_s = now_s + 0.2
        assert not first.shows(now_s + 0.2)
    assert n_taken_over == LOSSES + 1


def test_losses_now_and_then_are_no_conflict():
    conflict = NameConflict(0.0)
    for number in range(10 * LOSSES):
        lost_s = number * LOSSES_S / (LOSSES - 1)
        assert not conflict.shows(lost_s)
        conflict.connected_s = lost_s + 0.1
