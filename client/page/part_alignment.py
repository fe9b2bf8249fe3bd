"""Systems made of features: 3-2-1, best fit onto nominal places, leapfrog."""

from collections.abc import Iterator, Sequence

from traverse.client.display.follower import Follower
from traverse.client.display.inspection_desk import InspectionDesk
from traverse.client.inspection.best_fit import BestFit
from traverse.client.page.controls import Dialogs
from traverse.kinematics.helmert.transformation import Helmert
from traverse.plurals import counted
from traverse.protocol.messages.fields import Vector

LEAST_PLACES = 3
USE = "Use it"
MOVED, NOT_MOVED = "It was moved", "It was not moved"


class PartAlignment:
    """Asks for features, and has the arm state the part's coordinates.

    Args:
        follower: of the arm.
        desk: the part.
    """

    def __init__(
        self, follower: Follower, desk: InspectionDesk, dialogs: Dialogs
    ) -> None:
        self._follower = follower
        self._desk = desk
        self._dialogs = dialogs
        self._typed: dict[str, str] = {}  # nominal places, kept for the next time

    async def by_datums(self) -> None:
        places = ("The plane?", "The line along it?", "The point or centre?")
        chosen = await self.choose("Align 3-2-1", places, [*self._desk.features])
        if not chosen:
            return
        try:
            system = self._desk.align(chosen)
        except ValueError as error:
            self._follower.sight.refuse(str(error), "touch a plane, a line and a point")
            return
        await self._send(system)

    async def by_best_fit(self) -> None:
        """Ask for nominal places, show the fit's quality, and align on confirmation."""
        names = [
            name
            for name in (*self._desk.features, *self._desk.relations)
            if self._desk.has_place(name)
        ]
        if len(names) < LEAST_PLACES:
            self._follower.sight.refuse(
                "a best fit needs three features that have a place",
                "measure points, circles or spheres",
            )
            return
        answer, texts = await self._dialogs.ask(
            "Align by best fit: nominal places x y z in mm",
            ("Fit",),
            {name: self._typed.get(name, "") for name in names},
            "Of at least three features; what is empty is not used.",
        )
        if not answer:
            return
        self._typed = texts
        try:
            nominals_mm = {
                name: place_of(name, text) for name, text in texts.items() if text
            }
            fit = self._desk.fit(nominals_mm)
        except ValueError as error:
            self._follower.sight.refuse(
                str(error), "look at the nominal places, and at the features"
            )
            return
        words = "\n".join(fit_words(fit))
        answer, _ = await self._dialogs.ask("Best fit", (USE,), details=words)
        if answer == USE:
            self._desk.align_to(fit.system)
            await self._send(fit.system)

    async def begin_leapfrog(self) -> None:
        """Ask for the features once more, after the arm was moved."""
        answer, _ = await self._dialogs.ask(
            "Was the arm moved?",
            (MOVED,),
            details="Features with a place are touched once more, three at least; the "
            "part must stay where it is. Until they are joined, the arm states no "
            "part coordinates.",
        )
        if answer != MOVED:
            return
        try:
            self._desk.begin_leapfrog()
        except ValueError as error:
            self._follower.sight.refuse(
                str(error), "measure points, circles or spheres"
            )
            return
        await self._follower.do(lambda arm: arm.clear_alignment())

    async def end_leapfrog(self) -> None:
        """Show how what was touched again fits, and join it on confirmation."""
        self._desk.accept()
        try:
            fit = self._desk.fit_leapfrog()
        except ValueError as error:
            self._follower.sight.refuse(str(error), "touch more features again")
            return
        words = "\n".join(fit_words(fit))
        answer, _ = await self._dialogs.ask("Leapfrog", (USE,), details=words)
        if answer != USE:
            return
        system = self._desk.end_leapfrog(fit)
        if system is not None:
            await self._send(system)

    async def give_up_leapfrog(self) -> None:
        """Take the move back, and what was touched since."""
        answer, _ = await self._dialogs.ask(
            "The arm was not moved? What was touched again goes.", (NOT_MOVED,)
        )
        if answer != NOT_MOVED:
            return
        self._desk.end_leapfrog(None)
        if self._desk.alignment is not None:
            await self._send(self._desk.alignment)

    async def choose(
        self, title: str, places: Sequence[str], names: Sequence[str]
    ) -> list[str]:
        """Ask for a feature for each place; empty where the operator gives up."""
        chosen: list[str] = []
        for place in places:
            choices = [name for name in names if name not in chosen]
            if not choices:
                self._follower.sight.refuse(
                    f"{title} needs {counted(len(places), 'feature')}",
                    "touch its features first",
                )
                return []
            answer, _ = await self._dialogs.ask(f"{title}: {place}", choices)
            if not answer:
                return []
            chosen.append(answer)
        return chosen

    async def _send(self, system: Helmert) -> None:
        rows, name = system.rotation.tolist(), (self._desk.part or "part")[:60]
        shift_mm = system.translation_mm.tolist()
        await self._follower.do(lambda arm: arm.align(rows, shift_mm, name=name))


def place_of(name: str, text: str) -> Vector:
    """Read three coordinates, between blanks, semicolons, or commas.

    Raises:
        ValueError: they are none.
    """
    words = text.replace(";", " ").split()
    if len(words) == 1:
        words = text.split(",")
    elif len(words) == 3:
        # "12,5 0 3" has decimal commas; "12.5, 0, 3" has commas between.
        words = [word.rstrip(",").replace(",", ".") for word in words]
    try:
        x_mm, y_mm, z_mm = (float(word) for word in words)
    except ValueError:
        raise ValueError(
            f"{name}: '{text}' is no place; write three numbers, such as 12.5 0 -3"
        ) from None
    return x_mm, y_mm, z_mm


def fit_words(fit: BestFit) -> Iterator[str]:
    """Describe a fit: doubts first, then residuals, then what it is good for."""
    yield from (f"In doubt: {doubt}" for doubt in fit.doubts)
    for name, residual_mm in fit.residuals_mm.items():
        yield f"{name}: {' '.join(f'{mm:+.4f}' for mm in residual_mm)} mm"
    if fit.sigma0 is not None and fit.error is not None:
        yield (
            f"Residuals are {fit.sigma0:.2f} times what U lets expect "
            f"(redundancy {fit.redundancy})."
        )
    if fit.error is not None:
        yield (
            f"Touched places are good to {2.0 * fit.error.rms_mm:.4f} mm, "
            f"at the worst {2.0 * fit.error.max_mm:.4f} mm (k = 2)."
        )
    yield (
        f"An error of a feature counts {fit.index.rms_mm:.2f} times there, at the "
        f"worst {fit.index.max_mm:.2f} times."
    )
