"""How a page is served: to this machine, or beyond it with a token over TLS."""

from dataclasses import dataclass
from pathlib import Path

from nicegui import app, ui

from traverse.client.page.access import Guard
from traverse.client.page.connections import BoundedHttpProtocol


@dataclass(frozen=True, slots=True, kw_only=True)
class Serving:
    """Where a page listens, and who gets in.

    Attributes:
        token: Grants access to the page; None: access from this machine only.
    """

    host: str
    port: int
    token: str | None = None
    certificate: Path | None = None
    key: Path | None = None
    show: bool = False

    @property
    def url(self) -> str:
        scheme = "http" if self.certificate is None else "https"
        return f"{scheme}://{self.host}:{self.port}"


def serve_pages(serving: Serving) -> None:
    app.add_middleware(Guard, token=serving.token)
    ui.run(
        host=serving.host,
        port=serving.port,
        show=serving.show,
        reload=False,
        title="Traverse",
        language="en-US",
        show_welcome_message=False,
        http=BoundedHttpProtocol,
        ssl_certfile=None if serving.certificate is None else str(serving.certificate),
        ssl_keyfile=None if serving.key is None else str(serving.key),
    )
