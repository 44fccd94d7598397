"""The page's first document: where the server is, and what to load early."""

from pathlib import Path

from streamlit import file_util

from pdlab.page.served import CHARTS, HERE, document

STATIC = Path(file_util.get_static_dir())


def test_the_first_document_is_streamlits_and_begins_to_load_charts_where_they_are(tmp_path: Path) -> None:
    parts = tmp_path / "static" / "js"
    parts.mkdir(parents=True)
    (tmp_path / "index.html").write_text("<html><head><title>t</title></head><body></body></html>")
    assert document(tmp_path) == f"<html><head><title>t</title>{HERE}</head><body></body></html>"
    (parts / "PlotlyChart.abc.js").touch()
    loaded = '<script type="module">import("./static/js/PlotlyChart.abc.js")</script>'
    assert document(tmp_path) == f"<html><head><title>t</title>{HERE}{loaded}</head><body></body></html>"


def test_streamlit_still_keeps_its_charts_under_this_name_and_asks_where_the_server_is() -> None:
    text = document(STATIC)
    assert f'import("./static/js/{CHARTS}.' in text
    assert text.index(HERE) < text.index("</head>")
    entry = text.split('<script type="module" crossorigin src="./', 1)[1].split('"', 1)[0]
    assert "BACKEND_BASE_URL" in (STATIC / entry).read_text(encoding="utf-8")
