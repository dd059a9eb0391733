"""Makes the users of the S3 gateway and the policy of its bucket. It may run again.

Only this program and the gateway have the root keys. Services may read and write all objects of the bucket.
Workers may only use the folders that a build needs, without API keys, recorded queries and uploads.

    ROOT_ACCESS_KEY=... ROOT_SECRET_KEY=... SERVICE_SECRET_KEY=... WORKER_SECRET_KEY=... prepare-gateway.py
"""

from __future__ import annotations

import hashlib
import hmac
import json
import os
import sys
import time
import urllib.error
import urllib.request
from datetime import datetime, timezone
from urllib.parse import urlsplit
from xml.sax.saxutils import escape

ENDPOINT = os.environ.get("S3_ENDPOINT", "http://s3:7070")
BUCKET = os.environ.get("S3_BUCKET", "firstfix")
REGION = "us-east-1"
SERVICE, WORKER = "firstfix-service", "firstfix-worker"
WAIT_S = 120.0
READ = ["s3:GetObject"]
CHANGE = [*READ, "s3:PutObject", "s3:DeleteObject", "s3:AbortMultipartUpload", "s3:ListMultipartUploadParts"]
# Folders that a build reads and writes: sources and versions, records, finished stages, usage of callers, and
# notices of new versions for the replicas. probe: test objects of a worker that starts.
WORKERS_FOLDERS = ("maps", "builds", "stages", "changes", "callers", "probe")


def main() -> None:
    wait_for_the_gateway()
    make_user(SERVICE, os.environ["SERVICE_SECRET_KEY"])
    make_user(WORKER, os.environ["WORKER_SECRET_KEY"])
    send("PUT", f"/{BUCKET}", "policy=", json.dumps(policy()).encode())
    print("the gateway has its users")


def policy() -> dict[str, object]:
    """Returns the bucket's policy. The gateway has no conditions, so both users can list all object names."""
    bucket = f"arn:aws:s3:::{BUCKET}"

    def allow(user: str, actions: list[str], resources: list[str]) -> dict[str, object]:
        return {"Effect": "Allow", "Principal": {"AWS": [user]}, "Action": actions, "Resource": resources}

    look = ["s3:ListBucket", "s3:ListBucketMultipartUploads"]
    return {
        "Version": "2012-10-17",
        "Statement": [
            allow(SERVICE, look, [bucket]),
            allow(SERVICE, CHANGE, [f"{bucket}/*"]),
            allow(WORKER, look, [bucket]),
            allow(WORKER, CHANGE, [f"{bucket}/{folder}/*" for folder in WORKERS_FOLDERS]),
        ],
    }


def make_user(access: str, secret: str) -> None:
    """Makes a user, or sets the secret of an existing one."""
    named = f"<Access>{escape(access)}</Access><Secret>{escape(secret)}</Secret><Role>user</Role>"
    try:
        send("PATCH", "/create-user", "", f"<Account>{named}</Account>".encode())
    except urllib.error.HTTPError as error:
        if error.code != 409:
            raise
        changed = f"<MutableProps><Secret>{escape(secret)}</Secret><Role></Role></MutableProps>"
        send("PATCH", "/update-user", f"access={access}", changed.encode())


def wait_for_the_gateway() -> None:
    end = time.monotonic() + WAIT_S
    while True:
        try:
            send("HEAD", f"/{BUCKET}")
            return
        except urllib.error.HTTPError:
            raise
        except OSError:
            if time.monotonic() > end:
                raise
            time.sleep(0.5)


def send(method: str, path: str, query: str = "", body: bytes = b"") -> None:
    """Sends a request as the root user, signed with AWS signature version 4.

    Raises:
        HTTPError: the gateway refuses.
        OSError: it does not answer.
    """
    host = urlsplit(ENDPOINT).netloc
    now = datetime.now(timezone.utc).strftime("%Y%m%dT%H%M%SZ")
    digest = hashlib.sha256(body).hexdigest()
    headers = {"host": host, "x-amz-content-sha256": digest, "x-amz-date": now}
    names = ";".join(sorted(headers))
    lines = "".join(f"{name}:{headers[name]}\n" for name in sorted(headers))
    request = "\n".join([method, path, query, lines, names, digest])
    scope = f"{now[:8]}/{REGION}/s3/aws4_request"
    to_sign = "\n".join(["AWS4-HMAC-SHA256", now, scope, hashlib.sha256(request.encode()).hexdigest()])
    key = b"AWS4" + os.environ["ROOT_SECRET_KEY"].encode()
    for part in (*scope.split("/"), to_sign):
        key = hmac.new(key, part.encode(), hashlib.sha256).digest()
    credential = f"{os.environ['ROOT_ACCESS_KEY']}/{scope}"
    signed = f"AWS4-HMAC-SHA256 Credential={credential}, SignedHeaders={names}, Signature={key.hex()}"
    url = f"{ENDPOINT}{path}" + (f"?{query}" if query else "")
    given = {name: value for name, value in headers.items() if name != "host"}
    asked = urllib.request.Request(url, body or None, {**given, "Authorization": signed}, method=method)
    with urllib.request.urlopen(asked, timeout=20):
        pass


if __name__ == "__main__":
    sys.exit(main())
