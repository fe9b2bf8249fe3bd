from rich.console import Console

from tests.client.display.values import event, health, live, point, retraction, status
from traverse.cli.watch.view import picture
from traverse.client.display.arm_state import ArmSight


def shown(sight: ArmSight) -> str:
    console = Console(width=100, height=40)
    with console.capture() as captured:
        console.print(picture("bench-7", sight))
    return captured.get()


def well() -> ArmSight:
    sight = ArmSight(lambda: 5.0)
    sight.take_link(True, "")
    sight.take_status(status())
    sight.take_live(
        live(
            quality={"ok": True, "flags": []},
            xyz_mm=[1.5, -2.25, 3.0],
            part_xyz_mm=None,
        )
    )
    return sight


def test_it_shows_position_points_and_that_all_is_well() -> None:
    sight = well()
    sight.take_point(point(0, xyz_mm=[10.0, 20.0, 30.0]))
    sight.take_point(point(1, quality={"ok": False, "flags": ["end_stop"]}))
    sight.take_point(point(2))
    sight.take_point(retraction(3, of=2))
    text = shown(sight)
    assert "Ready to measure." in text
    assert "-2.2500 mm" in text
    assert "2 points" in text
    assert "20.0000" in text
    assert "end stop" in text


def test_it_says_what_is_wrong_and_what_to_do_and_what_is_old() -> None:
    now_s = [5.0]
    sight = well()
    sight.now_s = lambda: now_s[0]
    sight.take_event(
        event("device.lost", True, severity="error", text="gone", remedy="plug it in")
    )
    now_s[0] = 14.0
    text = shown(sight)
    assert ": gone" in text
    assert "plug it in" in text
    assert "STALE: 9 s old" in text


def test_before_anything_came_it_says_so() -> None:
    text = shown(ArmSight(lambda: 0.0))
    assert "No connection to the broker" in text
    assert "no pose yet" in text


def test_with_an_alignment_list_and_read_out_are_in_the_parts_system() -> None:
    sight = well()
    sight.take_live(live(part_xyz_mm=[7.0, -8.5, -1e-9]))
    sight.take_point(point(0, part_xyz_mm=[70.0, 80.0, 90.0]))
    sight.take_point(point(1, part_xyz_mm=None, xyz_mm=[666.0, 0.0, 0.0]))
    text = shown(sight)
    assert text.count("part's system") == 2
    assert "-8.5000 mm" in text
    assert "80.0000" in text
    assert "-0.0000" not in text
    assert "666" not in text


def test_nothing_is_reported_as_if_it_were_of_now_without_the_broker() -> None:
    sight = well()
    sight.take_health(health())
    assert "broker connected" in shown(sight)
    sight.take_link(False, "it is gone")
    text = shown(sight)
    assert "BROKER GONE" in text
    assert "connected" not in text
    assert "not known now" in text
    assert "0 points, out of date" in text
