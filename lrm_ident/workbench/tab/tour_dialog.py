"""The card of the guided tour."""

from __future__ import annotations

from dataclasses import dataclass

from nicegui import ui


@dataclass(frozen=True)
class TourStop:
    """One stop: the panel that it points to, its title, and what to see and do there."""

    panel: str
    title: str
    words: str


TOUR = (
    TourStop(
        "panel-field",
        "1 of 6: the error field",
        "Every dot is a measured tool position of a printed arm; every arrow points from where the model says the tool "
        "should be to where it was measured, magnified as printed below. The model was fitted already, yet the arrows "
        "follow a pattern. Drag to turn the scene; point at a dot to see its pose.",
    ),
    TourStop(
        "panel-turn",
        "2 of 6: where it fails",
        "The same errors as turns of one joint. Against the torque of joint 2 they jump where the torque changes sign. "
        "Try other joints and quantities: nowhere else is there such a step. Drag a box around some points: they are "
        "marked in every view.",
    ),
    TourStop(
        "panel-effect",
        "3 of 6: which effect",
        "Every known effect at every place was tried. The list says which held-out error each would leave: ● is "
        "supported, ◐ cannot be told from others, ○ has no evidence. Play in joint 2 is first by far.",
    ),
    TourStop(
        "panel-form",
        "4 of 6: its form beside the data",
        "Left: what the data do, and the formula of the chosen effect on them. Right: what it would add against what "
        "is missing. Where points follow the line the formula fits; choose another candidate to see one that does not.",
    ),
    TourStop(
        "panel-history",
        "5 of 6: press Add",
        "Press Add: everything is refitted with the effect. The error falls, fitted and held out, and the arrows "
        "shrink, on the same scale. Undo takes the step back exactly; press a step to see it again.",
    ),
    TourStop(
        "panel-effect",
        "6 of 6: know when to stop",
        "Once the held-out error has reached the noise floor, the verdict says that nothing is missing. Save the model "
        "for the rover, write a report, or drop your own CSV on this page.",
    ),
)


class TourDialog:
    """A card in the corner that says what the marked panel shows. `stop`: where the tour is."""

    def __init__(self) -> None:
        self.stop = -1
        with ui.element("section").classes("lrm-tour").props("role=dialog aria-label=tour") as self.card:
            self.title = ui.html("", sanitize=False)
            self.words = ui.label()
            with ui.row().classes("q-mt-sm"):
                self.back = ui.button("Back", on_click=lambda: self.go_to(self.stop - 1)).props("no-caps flat dense")
                ui.button("Next", on_click=lambda: self.go_to(self.stop + 1)).props("no-caps dense data-name=next")
                ui.button("Close", on_click=self.leave).props("no-caps flat dense data-name=close-tour")
        self.card.set_visibility(False)

    def go_to(self, stop: int) -> None:
        """Shows a stop; before the first and after the last the tour ends."""
        if not 0 <= stop < len(TOUR):
            self.leave()
            return
        self.stop = stop
        at = TOUR[stop]
        self.title.set_content(f"<h2>{at.title}</h2>")
        self.words.set_text(at.words)
        self.back.set_enabled(stop > 0)
        self.card.set_visibility(True)
        ui.run_javascript(f"lrmTour('{at.panel}')")

    def leave(self) -> None:
        """Ends the tour."""
        self.card.set_visibility(False)
        ui.run_javascript("lrmTour('')")
