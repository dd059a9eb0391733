"""Removes secrets from texts for other readers: log lines, problem documents, error messages."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterable, Mapping
from urllib.parse import quote, urlsplit

HIDDEN = "***"
# No pattern takes a quote or a backslash as part of a secret, so JSON stays valid. No pattern can begin
# inside text that it has already scanned, so that the time is linear in the length of an untrusted line. The
# words come first: a pattern matches only a text with one of them, in any case. They are found much faster.
_PATTERNS: tuple[tuple[tuple[str, ...], re.Pattern[str], str], ...] = (
    (("ffx_",), re.compile(r"\bffx_([0-9a-f]{12})_[0-9a-f]+"), rf"ffx_\1_{HIDDEN}"),
    # a JSON Web Token: parts that begin with {" in base64
    (("eyj",), re.compile(r"(?<![\w-])eyJ[\w-]+\.[\w.-]+"), HIDDEN),
    # a header's value: a scheme and a credential, not the sentence after it; in JSON it is quoted
    (
        ("authorization",),
        re.compile(
            r"""(?ix) (authorization (?: \\?["']\s*[:,]\s*b?\\?["'] | \s*[=:]\s*b?\\?["'] ))[^"'\\\r\n]+"""
        ),
        rf"\1{HIDDEN}",
    ),
    (
        ("authorization",),
        re.compile(r"""(?i)(authorization\s*[=:]\s*)(?:[\w-]{1,40}\s+)?[^\s"'\\]+"""),
        rf"\1{HIDDEN}",
    ),
    (("bearer", "basic"), re.compile(r"""(?i)\b(Bearer|Basic)(\s+)[^\s"'\\,;<>]{8,}"""), rf"\1\2{HIDDEN}"),
    # user:password@ of a URL; also of an invalid one, whose password has a slash
    (("://",), re.compile(r"""(\w://)[^\s"'\\<>/?#]{0,300}@"""), rf"\1{HIDDEN}@"),
    (
        ("://",),
        re.compile(r"""(\w://)[^\s"'\\<>/?#:@*]{0,100}:(?![0-9]{1,5}[/?#])[^\s"'\\<>]{0,300}@"""),
        rf"\1{HIDDEN}@",
    ),
    # name=value and "name": "value" if the name ends with a word for a secret, such as x-amz-signature
    (
        ("key", "secret", "passw", "pwd", "token", "sig", "credential", "cookie"),
        re.compile(
            r"""(?ix)( (?: api[_-]?key | access[_-]?key | account[_-]?key | secret[_-]?key | secret | password
                | passwd | pwd | token | signature | \bsig | credentials? | cookie )
                \\?["']? \s* [=:] \s* (?: b?\\?["'] | (?!b?\\?["']) ) )
                (?! (?:\*\*\*|null|None) (?:[\s"'\\,;&<>)\]}]|\Z) ) [^\s"'\\,;&<>)\]}]+"""
        ),
        rf"\1{HIDDEN}",
    ),
)
_SECRET_VARIABLE = re.compile(
    r"SECRET|PASSWORD|PASSWD|TOKEN|CREDENTIAL|SIGNATURE|API_?KEY|ACCOUNT_?KEY|_SAS|HEADERS", re.IGNORECASE
)
# Paths of files with secrets. A message about a file that cannot be read has to name it.
_PLACE_VARIABLE = re.compile(
    r"_(?:FILE|PATH|DIR)$|^FIRSTFIX_NATS_CREDENTIALS$|^GOOGLE_APPLICATION_CREDENTIALS$", re.IGNORECASE
)
_ENDPOINT_VARIABLE = re.compile(r"^OTEL_EXPORTER_OTLP_(?:[A-Z]+_)?ENDPOINT$")
_MIN_CHARS = 8  # a shorter value could occur anywhere


def redact(text: str) -> str:
    """Replace secrets in a text.

    Secrets are API keys (their id stays), JSON Web Tokens, values of Authorization, users and passwords in
    URLs, and values whose name implies a secret. The other text stays. Redacting twice changes nothing more.
    """
    lower, is_ascii = text.lower(), text.isascii()
    for words, pattern, shown in _PATTERNS:
        for word in words:
            # Beyond ASCII a pattern matches letters that are other ones in lower case, such as a long s.
            if word in lower or not is_ascii:
                text = pattern.sub(shown, text)
                break
    return text


def redactor(environment: Mapping[str, str] | None = None, urls: Iterable[str] = ()) -> Callable[[str], str]:
    """A function that redacts a text and hides the secrets of the environment.

    Secrets of the environment are the values of variables whose names imply one (AWS_SECRET_ACCESS_KEY, ...),
    and the paths of OpenTelemetry's endpoints. They are hidden as they are and as JSON writes them.

    Args:
        environment: variables; None: those of this process, at the time of the call.
        urls: whose paths and queries are secrets; their hosts stay.
    """
    variables = os.environ if environment is None else environment
    values = {
        value
        for name, value in variables.items()
        if _SECRET_VARIABLE.search(name) and not _PLACE_VARIABLE.search(name) and len(value) >= _MIN_CHARS
    }
    endpoints = [value for name, value in variables.items() if _ENDPOINT_VARIABLE.search(name)]
    for url in (*urls, *(url.removesuffix("/v1/traces") for url in endpoints)):
        values |= _secret_parts(url)
    forms = values | {json.dumps(value)[1:-1] for value in values}
    if not forms:
        return redact
    # the longest first, since one may begin with another
    known = re.compile("|".join(re.escape(form) for form in sorted(forms, key=len, reverse=True)))
    return lambda text: redact(known.sub(HIDDEN, text))


def _secret_parts(url: str) -> set[str]:
    """Path and query of a URL, as it is written and as HTTP sends it; with the host where they are short."""
    try:
        parts = urlsplit(url)
    except ValueError:
        return {url}
    path = parts.path.rstrip("/")
    target = f"{path}?{parts.query}" if parts.query else path
    if not target:
        return set()
    written = {target, quote(target, safe="/%?=&:+,;@!$'()*~")}
    return {one if len(one) >= _MIN_CHARS else f"{parts.netloc}{one}" for one in written}
