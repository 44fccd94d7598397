"""The page as a server runs it: its first document tells a browser at once what it would find out by and by."""

from pathlib import Path

import streamlit as st
from starlette.requests import Request
from starlette.responses import HTMLResponse
from starlette.routing import Route
from streamlit import config, file_util

from pdlab.page.app import VIEWS

HERE = '<script>window.__streamlit = {BACKEND_BASE_URL: new URL(".", location.href).href}</script>'
"""Where the server is: a view's address is no folder of it, in which a browser would ask first, wait, and go up one."""
CHARTS = "PlotlyChart"
"""The part of Streamlit's that takes a browser longest to read: it may begin while the view is made."""


def document(folder: Path) -> str:
    """Return the page's first document: Streamlit's, from the ``folder`` of what it serves, with what is known before.

    Where Streamlit keeps the charts under another name, they are loaded when they are needed, as without this.
    """
    found = sorted(folder.glob(f"static/js/{CHARTS}.*.js"))[:1]
    early = [f'<script type="module">import("./static/js/{file.name}")</script>' for file in found]
    text = (folder / "index.html").read_text(encoding="utf-8")
    return text.replace("</head>", "".join([HERE, *early, "</head>"]), 1)


def _routes() -> list[Route]:
    """Return the addresses at which the first document is asked for."""
    text = document(Path(file_util.get_static_dir()))

    async def answer(request: Request) -> HTMLResponse:
        return HTMLResponse(text, headers={"Cache-Control": "no-cache"})

    base = config.get_option("server.baseUrlPath").strip("/")
    return [Route("/".join(["", *filter(None, (base, address))]) or "/", answer) for address in ("", *VIEWS)]


app = st.App(Path(__file__).with_name("app.py"), routes=_routes())
