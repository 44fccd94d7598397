"""A small OpenID Connect provider for the tests: it lets everybody in at once, as one member of the laboratory."""

import base64
import json
import threading
import time
import urllib.parse
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from joserfc import jwt
from joserfc.jwk import RSAKey

CLIENT, SECRET, EMAIL = "pdlab", "a secret between page and provider", "ada@lab.example"


class Provider(ThreadingHTTPServer):
    """Discovery, authorization that redirects straight back, tokens, keys and claims.

    ``asked`` holds the paths that were asked for, ``refused`` why a token was not given.
    """

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.issuer = f"http://127.0.0.1:{self.server_address[1]}"
        self.key = RSAKey.generate_key(2048, parameters={"kid": "tests", "use": "sig", "alg": "RS256"})
        self.nonces, self.asked, self.refused = dict[str, str](), list[str](), list[str]()

    def discovery(self) -> dict[str, Any]:
        """Return what a client must know of the provider."""
        ends = {"authorization_endpoint": "authorize", "token_endpoint": "token", "jwks_uri": "jwks",
                "userinfo_endpoint": "userinfo"}  # fmt: skip
        return {
            "issuer": self.issuer,
            **{name: f"{self.issuer}/{path}" for name, path in ends.items()},
            "response_types_supported": ["code"],
            "subject_types_supported": ["public"],
            "id_token_signing_alg_values_supported": ["RS256"],
        }

    def tokens(self, form: dict[str, str], authorization: str) -> dict[str, Any] | None:
        """Return the tokens for a code that was given, None where client or code are none that it knows."""
        known = base64.b64encode(f"{CLIENT}:{urllib.parse.quote_plus(SECRET)}".encode()).decode()
        plain = base64.b64encode(f"{CLIENT}:{SECRET}".encode()).decode()
        if authorization not in (f"Basic {known}", f"Basic {plain}") or form.get("code") not in self.nonces:
            self.refused.append(f"{form.get('code')} with {authorization}")
            return None
        moment = int(time.time())
        claims = {"iss": self.issuer, "aud": CLIENT, "sub": "1", "email": EMAIL, "name": "Ada",
                  "iat": moment, "exp": moment + 600, "nonce": self.nonces.pop(form["code"])}  # fmt: skip
        token = jwt.encode({"alg": "RS256", "kid": "tests"}, claims, self.key)
        return {"access_token": "access", "token_type": "Bearer", "expires_in": 600, "id_token": token}


class _Handler(BaseHTTPRequestHandler):
    server: Provider

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing on the terminal of the tests."""

    def do_GET(self) -> None:
        split = urllib.parse.urlsplit(self.path)
        query = dict(urllib.parse.parse_qsl(split.query))
        self.server.asked.append(split.path)
        if split.path == "/authorize":
            code = f"code{len(self.server.nonces)}"
            self.server.nonces[code] = query["nonce"]
            back = urllib.parse.urlencode({"code": code, "state": query["state"]})
            self.send_response(302)
            self.send_header("Location", f"{query['redirect_uri']}?{back}")
            self.end_headers()
            return
        answers = {
            "/.well-known/openid-configuration": self.server.discovery(),
            "/jwks": {"keys": [self.server.key.as_dict(private=False)]},
            "/userinfo": {"sub": "1", "email": EMAIL},
        }
        self._answer(answers.get(split.path))

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"])).decode()
        self.server.asked.append(self.path)
        form = dict(urllib.parse.parse_qsl(body))
        self._answer(self.server.tokens(form, self.headers.get("Authorization", "")))

    def _answer(self, content: dict[str, Any] | None) -> None:
        self.send_response(200 if content is not None else 404)
        self.send_header("Content-Type", "application/json")
        self.end_headers()
        self.wfile.write(json.dumps(content or {}).encode())


@contextmanager
def provider() -> Iterator[Provider]:
    """Run a provider on a free port of this machine."""
    made = Provider()
    thread = threading.Thread(target=made.serve_forever, daemon=True)
    thread.start()
    try:
        yield made
    finally:
        made.shutdown()
        made.server_close()
        thread.join()


def secrets_toml(issuer: str, page: str) -> str:
    """Return the secrets.toml of a page that trusts a provider."""
    return (
        f'[auth]\nredirect_uri = "{page}/oauth2callback"\ncookie_secret = "{"0123456789abcdef" * 4}"\n'
        f'client_id = "{CLIENT}"\nclient_secret = "{SECRET}"\n'
        f'server_metadata_url = "{issuer}/.well-known/openid-configuration"\n'
    )
