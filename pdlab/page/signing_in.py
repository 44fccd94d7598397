"""Who may see the page: all who reach it, or who has signed in where secrets.toml has a section [auth] (OIDC)."""

import importlib.util
import os
import tomllib
from collections.abc import Container, Iterable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

import streamlit as st
from streamlit import config
from streamlit.errors import StreamlitSecretNotFoundError

from pdlab.errors import SignInError
from pdlab.page.wording import plain

AUTH = "auth"
NEEDED = ("redirect_uri", "cookie_secret")
OF_PROVIDER = ("client_id", "client_secret", "server_metadata_url")
CALLBACK = "/oauth2callback"
SECRET = 32  # characters of a cookie_secret at least: who guesses it signs in as anybody
MODULES = ("authlib", "httpx")
ASKED_FOR = "pdlab_asked_for"  # a cookie: whoever has signed in comes to the page's root, in a new session
KEEP = "<script>document.cookie='{}=' + {} + '; path=/; max-age={}; SameSite=Lax'</script>"
REQUIRED = "PDLAB_SIGN_IN"  # set with a sign-in, and by a page that has seen one: without one the page stays closed


def is_admitted() -> bool:
    """Return whether the store may be shown in this session. Raises SignInError."""
    section = _section()
    if section is None and not os.environ.get(REQUIRED):
        return True
    if section is None:
        raise SignInError(f"secrets.toml has no section [{AUTH}] any more; put it back, or start the page anew")
    os.environ[REQUIRED] = "1"
    providers(section)
    return bool(st.user.get("is_logged_in", False))


def ask() -> None:
    """Offer to sign in, and show nothing else."""
    st.title("pdlab", anchor=False)
    st.markdown("Sign in to see the laboratory's aggregates and mixtures.")
    for name in providers(_section() or {}):
        words = "Sign in" if name is None else f"Sign in with {name}"
        st.button(plain(words), type="primary", on_click=st.login, args=(name,), key=f"sign_in_{name or ''}")
    _keep("encodeURIComponent(location.pathname + location.search)", seconds=900)


def asked_for(addresses: Container[str]) -> tuple[str, dict[str, list[str]]] | None:
    """Return which of the views' addresses was asked for before the sign-in, and its query."""
    if not st.user.get("is_logged_in", False):
        return None
    asked = urlsplit(unquote(st.context.cookies.get(ASKED_FOR, "")))
    address = asked.path.rpartition("/")[2]
    return (address, parse_qs(asked.query)) if address in addresses else None


def _keep(value: str, seconds: int) -> None:
    """Keep the value of a JavaScript expression in the cookie."""
    st.html(KEEP.format(ASKED_FOR, value, seconds), width="content", unsafe_allow_javascript=True)


def say() -> None:
    """Say who is signed in, beside a button that signs out; nothing where nobody need sign in."""
    if not (name := signed_in()):
        return
    with st.container(horizontal=True, horizontal_alignment="right", vertical_alignment="center"):
        st.text(f"Signed in as {name}", width="content")  # as Markdown an address would be a link
        st.button("Sign out", on_click=st.logout, key="sign_out", type="tertiary")
        if ASKED_FOR in st.context.cookies:  # told once
            _keep("''", seconds=0)


def signed_in() -> str:
    """Return who is signed in: the e-mail address, else the name, else the provider's key; empty without a sign-in."""
    if not st.user.get("is_logged_in", False):
        return ""
    claims = (st.user.get(name) for name in ("email", "name", "sub"))
    return next((str(claim) for claim in claims if claim), "somebody without a name")


def is_configured(files: Iterable[str] | None = None) -> bool:
    """Return whether secrets files, those of Streamlit without any, ask for a sign-in. Raises SignInError."""
    secrets = dict[str, Any]()
    for file in map(Path, config.get_option("secrets.files") if files is None else files):
        if file.suffix == ".toml" and file.exists():
            try:
                secrets |= tomllib.loads(file.read_text(encoding="utf-8"))
            except (OSError, ValueError) as error:
                raise SignInError(f"{file} cannot be read ({error}); mend it, or take it away") from error
    if AUTH not in secrets:
        return False
    providers(secrets[AUTH])
    return True


def providers(section: Mapping[str, Any]) -> list[str | None]:
    """Return the names of the providers that a section [auth] has, None for that of [auth] itself.

    Raises SignInError with what is missing or cannot be, and the remedy.
    """
    if not isinstance(section, Mapping):
        raise SignInError(f"{AUTH} is no section in secrets.toml; write [{AUTH}] and below it {', '.join(NEEDED)}")
    missing = [name for name in MODULES if importlib.util.find_spec(name) is None]
    if missing:
        raise SignInError(
            f"signing in needs what is not installed ({', '.join(missing)}); install it with "
            "pip install 'pdlab[signin]'"
        )
    _check_shared(section)
    named = {key: value for key, value in section.items() if isinstance(value, Mapping) and key != "client_kwargs"}
    for name, values in (named or {"": section}).items():
        _check_provider(name, values)
    return [*named] or [None]


def _check_shared(section: Mapping[str, Any]) -> None:
    _check_there(AUTH, section, NEEDED)
    address, secret = str(section["redirect_uri"]), str(section["cookie_secret"])
    if not address.startswith(("http://", "https://")) or not address.endswith(CALLBACK):
        raise SignInError(
            f"redirect_uri in secrets.toml is '{address}', not http(s)://HOST{CALLBACK}; write the page's own address "
            f"with {CALLBACK} behind it"
        )
    if len(secret) < SECRET:
        raise SignInError(
            f"cookie_secret in secrets.toml has {len(secret)} characters, fewer than {SECRET}; take what "
            '`python -c "import secrets; print(secrets.token_hex(32))"` prints'
        )


def _check_provider(name: str, values: Mapping[str, Any]) -> None:
    if "_" in name:
        raise SignInError(f"[{AUTH}.{name}] has an underscore in its name, which Streamlit does not take; rename it")
    _check_there(f"{AUTH}.{name}" if name else AUTH, values, OF_PROVIDER)


def _check_there(section: str, values: Mapping[str, Any], keys: Iterable[str]) -> None:
    missing = [key for key in keys if not values.get(key)]
    if missing:
        raise SignInError(f"[{section}] in secrets.toml lacks {', '.join(missing)}; enter what docs/operation.md says")


def _section() -> Mapping[str, Any] | None:
    """Return what the page's secrets say of the sign-in, None where they say nothing. Raises SignInError."""
    try:
        secrets = st.secrets.to_dict()
    except (OSError, ValueError) as error:
        absent = isinstance(error, StreamlitSecretNotFoundError) and not any(
            Path(file).exists() for file in config.get_option("secrets.files")
        )
        if absent:
            return None
        raise SignInError(f"the page's secrets cannot be read ({error}); mend or remove that file") from error
    return secrets.get(AUTH)
