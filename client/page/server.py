"""The page's server: one arm followed, any number of browsers."""

import asyncio
import logging
from collections.abc import Callable

from fastapi import Response
from fastapi.responses import FileResponse, HTMLResponse
from nicegui import app, ui

from traverse.client.cancel_tasks import cancel_tasks
from traverse.client.display.follower import Follower
from traverse.client.display.guided_check import CheckDesk
from traverse.client.display.inspection_desk import InspectionDesk
from traverse.client.inspection.sheet import sheet_html
from traverse.client.page.language import CATALOGUE, CATALOGUE_URL
from traverse.client.page.operator_page import OperatorPage
from traverse.client.page.part_panel import REPORT_URL
from traverse.client.page.readout import Choices
from traverse.client.page.serving import Serving, serve_pages
from traverse.protocol.messages import Point

log = logging.getLogger(__name__)

CLOUD_URL = "/cloud"
RECONNECT_S = 10.0

Export = Callable[[str, list[Point]], tuple[str, bytes]]


def serve(follower: Follower, export: Export, serving: Serving, logo: str = "") -> None:
    """Serve the page until the process is requested to end.

    Args:
        follower: of the arm.
        export: returns points as a file of some kind: name and content.
        serving: where, and for whom.
        logo: of the report, a data URI.
    """
    tasks: list[asyncio.Task[None]] = []
    desk, choices = CheckDesk(follower.sight), Choices()
    inspection_desk = InspectionDesk(follower.sight)

    async def begin() -> None:
        tasks.append(asyncio.create_task(follower.run()))

    async def leave() -> None:
        await cancel_tasks(tasks)

    app.on_startup(begin)
    app.on_shutdown(leave)

    @app.get(CLOUD_URL)
    def cloud(version: int, start: int) -> Response:
        if version != follower.cloud.version or start < 0:
            return Response(status_code=409)
        content = follower.cloud.bytes_from(start)
        return Response(
            content,
            media_type="application/octet-stream",
            headers={"x-seen": str(follower.cloud.n_seen)},
        )

    @app.get(CATALOGUE_URL)
    def languages() -> FileResponse:
        return FileResponse(CATALOGUE, media_type="text/tab-separated-values")

    @app.get(REPORT_URL)
    def report() -> HTMLResponse:
        if inspection_desk.inspection is None:
            return HTMLResponse("Nothing is measured yet.", 404)
        return HTMLResponse(sheet_html(inspection_desk.inspection, logo))

    @ui.page("/", title=f"{follower.name} - Traverse", reconnect_timeout=RECONNECT_S)
    def page() -> None:
        OperatorPage(
            follower,
            desk,
            inspection_desk,
            choices,
            cloud_url=CLOUD_URL,
            export=export,
        )

    serve_pages(serving)
