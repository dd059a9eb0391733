#!/usr/bin/env bash
# obstore, S3: where create-only puts are switched off, put(mode="create") raises Python's own NotImplementedError.
#
# Version: obstore 0.12.1 (Python 3.11). Nothing is sent: there need be no server.
# Behaviour: with aws_conditional_put="disabled" (or AWS_CONDITIONAL_PUT=disabled, which is set for stores that do not
# honour If-None-Match), put(..., mode="create") raises the builtin NotImplementedError. obstore.exceptions has
# NotSupportedError, and BaseError as the parent of its errors: neither catches it.
# Who catches obstore's errors to fall back, or to say that the store cannot do it, gets a traceback instead.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check obstore==0.12.1
"$folder/venv/bin/python" - <<'PYTHON'
import obstore
from obstore import exceptions
from obstore.store import S3Store

store = S3Store(
    "bucket", region="us-east-1", endpoint="http://127.0.0.1:9", access_key_id="a", secret_access_key="b",
    conditional_put="disabled", client_options={"allow_http": True},
)
try:
    obstore.put(store, "key", b"content", mode="create")
except Exception as error:
    print(f"{type(error).__module__}.{type(error).__name__}: {str(error).splitlines()[0]}")
    assert type(error) is NotImplementedError, "another error than the builtin one: the behaviour has changed"
    assert not isinstance(error, exceptions.BaseError)
    assert not issubclass(exceptions.NotSupportedError, NotImplementedError)
else:
    raise SystemExit("no error: the behaviour has changed")
PYTHON
# Output seen:
#   builtins.NotImplementedError: Operation `put_opts` with mode `PutMode::Create` when conditional put is disabled not yet implemented by AmazonS3(bucket).
echo "as described"
