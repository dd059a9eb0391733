"""Secrets out of a text that will be read by others: a log line, a problem document, an error message."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Mapping

HIDDEN = "***"
# No pattern takes a quote or a backslash as part of a secret, so JSON stays JSON; and none can begin inside
# what another try at it has read, so that a long line of a stranger's costs no more than its length.
_PATTERNS: tuple[tuple[re.Pattern[str], str], ...] = (
    (re.compile(r"\bffx_([0-9a-f]{12})_[0-9a-f]+"), rf"ffx_\1_{HIDDEN}"),
    # a JSON Web Token: parts that begin with {" in base64
    (re.compile(r"(?<![\w-])eyJ[\w-]+\.[\w.-]+"), HIDDEN),
    # a header's value: a scheme and a credential, not the sentence after it; in JSON it is quoted
    (
        re.compile(
            r"""(?ix) (authorization (?: \\?["']\s*[:,]\s*b?\\?["'] | \s*[=:]\s*b?\\?["'] ))[^"'\\\r\n]+"""
        ),
        rf"\1{HIDDEN}",
    ),
    (
        re.compile(r"""(?i)(authorization\s*[=:]\s*)(?:[\w-]{1,40}\s+)?[^\s"'\\]+"""),
        rf"\1{HIDDEN}",
    ),
    (re.compile(r"""(?i)\b(Bearer|Basic)(\s+)[^\s"'\\,;<>]{8,}"""), rf"\1\2{HIDDEN}"),
    # user:password@ of a URL; and of one that no parser takes, as its password has a slash
    (re.compile(r"""(\w://)[^\s"'\\<>/?#]{0,300}@"""), rf"\1{HIDDEN}@"),
    (
        re.compile(r"""(\w://)[^\s"'\\<>/?#:@*]{0,100}:(?![0-9]{1,5}[/?#])[^\s"'\\<>]{0,300}@"""),
        rf"\1{HIDDEN}@",
    ),
    # name=value and "name": "value", of names that tell a secret, at their end: x-amz-signature as well
    (
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
# They say where a secret is. A message about a file that cannot be read has to name it.
_PLACE_VARIABLE = re.compile(
    r"_(?:FILE|PATH|DIR)$|^FIRSTFIX_NATS_CREDENTIALS$|^GOOGLE_APPLICATION_CREDENTIALS$", re.IGNORECASE
)
_MIN_CHARS = 8  # a shorter value would be found everywhere


def redact(text: str) -> str:
    """The text with what has the form of a secret replaced: API keys (their id stays), JSON Web Tokens,
    Authorization values, users and passwords of URLs, and values under names that tell a secret. What
    stands around them stays, and a text that was redacted before is left as it is."""
    for pattern, shown in _PATTERNS:
        text = pattern.sub(shown, text)
    return text


def redactor(environment: Mapping[str, str] | None = None) -> Callable[[str], str]:
    """As ``redact``, and the values of variables whose names tell a secret (AWS_SECRET_ACCESS_KEY, ...),
    whatever form they have, as they are and as JSON writes them.

    Args:
        environment: None: this process's, as it is now.
    """
    values = {
        value
        for name, value in (os.environ if environment is None else environment).items()
        if _SECRET_VARIABLE.search(name) and not _PLACE_VARIABLE.search(name) and len(value) >= _MIN_CHARS
    }
    forms = values | {json.dumps(value)[1:-1] for value in values}
    # the longest first: one may begin with another
    known = re.compile("|".join(re.escape(form) for form in sorted(forms, key=len, reverse=True)) or r"(?!)")
    return lambda text: redact(known.sub(HIDDEN, text))
