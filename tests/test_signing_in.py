"""Signing in: off unless secrets.toml has [auth]; then the store is shown to nobody before; what is wrong is said."""

import re
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import streamlit as st
from oidc import secrets_toml
from servers import free_port
from streamlit.testing.v1 import AppTest
from streamlit.util import calc_hash
from test_page import PAGE, lab, plain

from pdlab import experiments
from pdlab.errors import InputError, SignInError
from pdlab.lab import SHIPPED
from pdlab.page import signing_in
from pdlab.page.app import VIEWS
from pdlab.store import Store
from pdlab.tables import read_path

__all__ = ["lab"]
AUTH: Mapping[str, Any] = {
    "redirect_uri": "http://127.0.0.1:8501/oauth2callback",
    "cookie_secret": "0123456789abcdef0123456789abcdef",
    "client_id": "pdlab",
    "client_secret": "secret",
    "server_metadata_url": "http://127.0.0.1:9/.well-known/openid-configuration",
}
PROVIDER = {name: AUTH[name] for name in signing_in.OF_PROVIDER}
SHARED = {name: AUTH[name] for name in signing_in.NEEDED}


@pytest.fixture(autouse=True)
def _begun_without(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget after a test that its page had a sign-in, which a page never does."""
    monkeypatch.setenv(signing_in.REQUIRED, "")


def view(address: str, auth: Any = None, user: Mapping[str, Any] | None = None) -> AppTest:
    app = AppTest.from_file(str(PAGE), default_timeout=60)
    app._page_hash = calc_hash(address)
    if auth is not None:
        app.secrets = {"auth": auth}
    app.user = dict(user or {})
    app.run()
    assert not app.exception
    return app


def buttons(app: AppTest) -> list[str]:
    """Return what the page offers for signing in and out."""
    return [button.label.replace("\\", "") for button in app.button if str(button.key).startswith("sign_")]


def without(key: str) -> dict[str, Any]:
    return {name: value for name, value in AUTH.items() if name != key}


def test_before_signing_in_nothing_of_the_store_is_read_or_shown_on_any_view(
    lab: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiments.register(lab, read_path(SHIPPED))
    monkeypatch.setattr(Store, "read", None)
    monkeypatch.setattr(Store, "write", None)
    for address in VIEWS:
        app = view(address, AUTH)
        assert buttons(app) == ["Sign in"]
        assert [title.value for title in app.title] == ["pdlab"]
        assert not [*app.table, *app.dataframe, *app.text_input, *app.selectbox, *app.error]


ASKED = [
    ("%2Fmixtures%3Fmixture%3D2%26name%3Da%2Bb", True, ("mixtures", {"mixture": ["2"], "name": ["a b"]})),
    ("%2Flab%2Faggregates", True, ("aggregates", {})),
    ("%2Fmixtures%3Fmixture%3D2", False, None),
    ("%2F", True, None),
    ("%2F%2Felsewhere.example%2Fx", True, None),
    ("", True, None),
]


@pytest.mark.parametrize(("cookie", "signed_in", "found"), ASKED)
def test_the_view_that_was_asked_for_is_one_of_the_page_s_or_none(
    monkeypatch: pytest.MonkeyPatch, cookie: str, signed_in: bool, found: object
) -> None:
    context = SimpleNamespace(cookies={signing_in.ASKED_FOR: cookie} if cookie else {})
    monkeypatch.setattr(signing_in, "st", SimpleNamespace(user={"is_logged_in": signed_in}, context=context))
    assert signing_in.asked_for(VIEWS) == found


def test_who_has_signed_in_sees_the_page_and_can_sign_out(lab: Store) -> None:
    app = view("aggregates", AUTH, {"is_logged_in": True, "email": "ada*b@lab.example"})
    assert buttons(app) == ["Sign out"]
    assert [title.value for title in app.title] == ["Aggregates"]
    assert [text.value for text in app.text] == ["Signed in as ada*b@lab.example"]
    app.button(key="sign_out").click().run()
    assert buttons(app) == ["Sign in"]


def test_a_page_without_a_section_auth_asks_nobody(lab: Store) -> None:
    assert buttons(view("aggregates")) == []


def test_only_who_is_signed_in_is_admitted(lab: Store) -> None:
    for user in ({}, {"is_logged_in": False, "email": "ada@lab.example"}, {"email": "ada@lab.example"}):
        assert buttons(view("aggregates", AUTH, user)) == ["Sign in"]


def test_several_providers_have_a_button_each(lab: Store) -> None:
    assert buttons(view("mixtures", {**SHARED, "google": PROVIDER, "lab": PROVIDER})) == [
        "Sign in with google",
        "Sign in with lab",
    ]


WRONG = [
    *[(without(key), f"lacks {key}") for key in AUTH],
    ({**AUTH, "redirect_uri": "http://lab.example"}, "redirect_uri in secrets.toml is 'http://lab.example'"),
    ({**AUTH, "redirect_uri": "lab.example/oauth2callback"}, "not http(s)://HOST/oauth2callback"),
    ({**AUTH, "cookie_secret": "xxx"}, "cookie_secret in secrets.toml has 3 characters, fewer than 32"),
    ({**SHARED, "my_lab": PROVIDER}, "has an underscore in its name"),
    ({**SHARED, "lab": {}}, "[auth.lab] in secrets.toml lacks client_id, client_secret, server_metadata_url"),
    ("yes", "auth is no section in secrets.toml"),
]


@pytest.mark.parametrize(("auth", "sentence"), WRONG)
def test_a_sign_in_that_is_configured_wrongly_is_a_sentence_and_lets_nobody_in(
    auth: Mapping[str, Any], sentence: str
) -> None:
    with pytest.raises(SignInError) as error:
        signing_in.providers(auth)
    assert sentence in str(error.value)


def test_the_page_says_what_is_wrong_with_its_sign_in(lab: Store) -> None:
    app = view("aggregates", {**AUTH, "cookie_secret": "xxx"}, {"is_logged_in": True})
    (sentence,) = plain(app)[1]
    assert "cookie_secret in secrets.toml has 3 characters" in sentence
    assert not [*app.title, *app.button, *app.text_input]


def test_a_missing_authlib_is_a_sentence(lab: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signing_in, "MODULES", ("authlib", "no_such_module"))
    (sentence,) = plain(view("aggregates", AUTH))[1]
    assert sentence.endswith("not installed (no_such_module); install it with pip install 'pdlab[signin]'")


@pytest.mark.parametrize("by_serve", [True, False])
def test_a_sign_in_that_is_taken_away_while_the_page_runs_opens_it_to_nobody(
    lab: Store, monkeypatch: pytest.MonkeyPatch, by_serve: bool
) -> None:
    if by_serve:
        monkeypatch.setenv(signing_in.REQUIRED, "1")
    else:  # started by app.py: nobody has told the page that it needs one
        assert buttons(view("aggregates", AUTH)) == ["Sign in"]
    (sentence,) = plain(view("aggregates"))[1]
    assert "has no section [auth] any more" in sentence


@pytest.mark.parametrize("content", [b"[auth", b"[auth]\nclient_id = '\xff'"])
def test_secrets_that_cannot_be_read_open_the_page_to_nobody(
    lab: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: bytes
) -> None:
    file = tmp_path / "secrets.toml"
    file.write_bytes(content)
    with pytest.raises(SignInError, match=r"secrets\.toml cannot be read"):
        signing_in.is_configured([str(file)])
    before = st.config.get_option("secrets.files")
    st.config.set_option("secrets.files", [str(file)])
    monkeypatch.setattr(st, "secrets", type(st.secrets)())
    try:
        (sentence,) = plain(view("aggregates"))[1]
    finally:
        st.config.set_option("secrets.files", before)
    assert "the page's secrets cannot be read" in sentence


def test_a_sign_in_is_configured_where_a_file_has_the_section(tmp_path: Path) -> None:
    first, second = tmp_path / "one.toml", tmp_path / "secrets.toml"
    first.write_text("[other]\nx = 1\n")
    second.write_text(secrets_toml("http://127.0.0.1:9", "http://127.0.0.1:8501"))
    assert not signing_in.is_configured([str(first), str(tmp_path / "none.toml")])
    assert signing_in.is_configured([str(first), str(second)])


def test_serve_listens_to_a_network_only_with_a_sign_in(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pdlab.cli", "serve", "--port", str(free_port()), "--address", "0.0.0.0"]
    done = subprocess.run(command, check=False, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    for sentence in ("everybody in the network could write", "no sign-in is configured", "docs/operation.md"):
        assert sentence in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "pdlab.db").exists()


def test_a_place_beyond_this_machine_is_allowed_with_a_sign_in_and_this_machine_always() -> None:
    from pdlab.cli.serving import _checked_place

    for address, signed_in in (("127.0.0.1", False), ("localhost", False), ("0.0.0.0", True)):
        _checked_place(address, free_port(), signed_in)
    with pytest.raises(InputError, match="is no address of this machine"):
        _checked_place("no.such.host.invalid", free_port(), True)
    with pytest.raises(InputError, match="or not of this machine"):
        _checked_place("192.0.2.1", free_port(), True)


@pytest.mark.parametrize("address", ["0", "::", "*", "::ffff:0.0.0.0"])
def test_no_spelling_of_all_addresses_passes_for_this_machine(address: str) -> None:
    from pdlab.cli.serving import _checked_place

    with pytest.raises(SignInError, match="everybody in the network could write to the store"):
        _checked_place(address, free_port(), signed_in=False)


@pytest.mark.parametrize("address", ["", "a..b", "a" * 300, "http://127.0.0.1", "unix:///tmp/page"])
def test_what_is_no_address_is_a_sentence(address: str) -> None:
    from pdlab.cli.serving import _checked_place

    with pytest.raises(InputError, match=f"^'{re.escape(address)}' is no address of this machine"):
        _checked_place(address, free_port(), signed_in=True)


def test_the_page_listens_at_the_number_that_was_checked_whatever_else_a_name_stands_for(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Streamlit would ask again what the name stands for, and take an address of IPv4 alone."""
    from pdlab.cli import serving

    def start(command: list[str], **_: Any) -> None:
        started.append(command)
        sys.exit(0)

    started = list[list[str]]()
    answers = [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (number, 0)) for number in ("127.0.0.1", "192.0.2.1")]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: answers)
    monkeypatch.setattr(subprocess, "Popen", start)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    with pytest.raises(SystemExit):
        serving.serve(str(tmp_path / "lab.db"), free_port(), "lab", runner=False)
    (command,) = started
    assert "--server.address=127.0.0.1" in command
