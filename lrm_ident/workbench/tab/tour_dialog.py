"""The card of the guided tour."""

from __future__ import annotations

from nicegui import ui

from lrm_ident.workbench.tab.tour import TOUR


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
