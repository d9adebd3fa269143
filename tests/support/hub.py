"""A stand-in for the Hugging Face hub: what its clients ask for repositories, on a local port.

It knows, for repositories of kind `dataset`, and of kind `model` with `models` in place of
`datasets`, which is left out of addresses that do not begin with `api`:

    POST   /api/repos/create, /api/validate-yaml
    GET    /api/datasets/<repo>[/revision/<rev>], …/refs, …/tree/<rev>[/<folder>]
    POST   /api/datasets/<repo>/{paths-info,preupload,commit,tag}/<rev>
    DELETE /api/datasets/<repo>/tag/<tag>
    POST   /datasets/<repo>.git/info/lfs/objects/batch, and PUT of the objects (basic transfer)
    HEAD, GET /datasets/<repo>/resolve/<rev>/<path>, whole or a range

Anything else is answered 501 and remembered in `Hub.unknown`. It does not know Xet, which the hub
prefers for uploads: clients need HF_HUB_DISABLE_XET=1.
"""

import base64
import hashlib
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

from tests.support.hub_state import LARGE, Entry, Hub, Repo

TOKEN = "hf_stand_in"


@contextmanager
def running_hub() -> Iterator[Hub]:
    """Serve a hub without repositories on a free local port."""
    hub = Hub()
    server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(hub))
    hub.url = f"http://127.0.0.1:{server.server_port}"
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield hub
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def _handler(hub: Hub) -> type[BaseHTTPRequestHandler]:
    class Handler(_Handler):
        state = hub

    return Handler


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    state: Hub

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""

    def do_GET(self) -> None:
        self._serve()

    do_HEAD = do_POST = do_PUT = do_DELETE = do_GET  # noqa: N815 (the server's names)

    def _serve(self) -> None:
        url = urlsplit(self.path)
        # Revisions and paths come quoted, with %2F between their parts.
        self.parts = [unquote(part) for part in url.path.strip("/").split("/")]
        self.query = {key: values[0] for key, values in parse_qs(url.query).items()}
        call = f"{self.command} {unquote(url.path)}"
        self.state.calls.append(call)
        length = int(self.headers.get("Content-Length") or 0)
        if length and self.state.take_drop(self.command, url.path):
            self.rfile.read(length // 2)
            self._cut()
            return
        self.body = (
            self._chunks()
            if "chunked" in self.headers.get("Transfer-Encoding", "")
            else self.rfile.read(length)
        )
        if self.body is None:
            return
        match self.parts:
            case ["api", "repos", "create"]:
                self._create()
            case ["api", "validate-yaml"]:
                self._json({"errors": [], "warnings": []})
            case ["api", "datasets" | "models", user, name, *rest]:
                self._api(f"{user}/{name}", rest)
            case [*_, user, name, "info", "lfs", "objects", "batch"]:
                self._batch(f"{user}/{name.removesuffix('.git')}")
            case ["lfs", oid] if self.command == "PUT":
                self._store(oid)
            case ["datasets", user, name, "resolve", revision, *path]:
                self._resolve(f"{user}/{name}", revision, "/".join(path))
            case [user, name, "resolve", revision, *path]:
                self._resolve(f"{user}/{name}", revision, "/".join(path))
            case _:
                self._unknown()

    def _chunks(self) -> bytes | None:
        """A chunked body; None when the connection is cut within it."""
        parts = []
        drop = self.state.take_drop(self.command, self.path)
        while size := int(self.rfile.readline().split(b";")[0], 16):
            parts.append(self.rfile.read(size))
            self.rfile.readline()
            if drop:
                self._cut()
                return None
        self.rfile.readline()
        return b"".join(parts)

    # Answers.

    def _json(self, value: Any, status: int = 200, **headers: str) -> None:
        data = json.dumps(value).encode()
        self._send(status, data, {"Content-Type": "application/json", **headers})

    def _error(self, status: int, code: str, message: str) -> None:
        data = json.dumps({"error": message}).encode()
        self._send(status, data, {"X-Error-Code": code, "X-Error-Message": message})

    def _send(self, status: int, data: bytes, headers: dict[str, str]) -> None:
        self.send_response(status)
        for key, value in headers.items():
            self.send_header(key, value)
        if "Content-Length" not in headers:
            self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        if self.command == "HEAD":
            return
        if self.command == "GET" and self.state.take_drop("GET", self.path):
            self.wfile.write(data[: len(data) // 2])
            self._cut()
            return
        self.wfile.write(data)

    def _cut(self) -> None:
        self.close_connection = True
        self.wfile.flush()
        self.connection.close()

    def _unknown(self) -> None:
        self.state.unknown.append(f"{self.command} {self.path}")
        self._error(501, "NotImplemented", "the stand-in does not know this")

    # Rights.

    def _signed_in(self) -> bool:
        return self.headers.get("Authorization") == f"Bearer {TOKEN}"

    def _repo(self, name: str, write: bool = False) -> Repo | None:
        """The repository, or None when the error was sent."""
        repo = self.state.repos.get(name)
        if repo is None or (repo.private and not self._signed_in()):
            # The hub does not reveal to others what exists.
            status = 404 if self._signed_in() else 401
            self._error(status, "RepoNotFound", "Repository not found")
            return None
        if write and not self._signed_in():
            self._error(401, "", "Invalid username or password.")
            return None
        return repo

    # What clients ask.

    def _create(self) -> None:
        asked = json.loads(self.body or b"")
        name = f"{asked['organization']}/{asked['name']}"
        if not self._signed_in():
            self._error(401, "", "Invalid username or password.")
        elif asked.get("type", "model") not in ("dataset", "model"):
            self._unknown()
        elif name in self.state.repos:
            self._json(
                {"error": "You already created this dataset repo", "url": self._url(name)}, 409
            )
        else:
            repo = self.state.repos[name] = Repo(asked.get("visibility") == "private")
            repo.commit({".gitattributes": Entry(b"*.parquet filter=lfs\n", False)}, "initial")
            self._json({"url": self._url(name), "name": name})

    def _url(self, name: str) -> str:
        return f"{self.state.url}/datasets/{name}"

    def _api(self, name: str, rest: list[str]) -> None:
        repo = self._repo(name, write=self.command != "GET" and rest[0] != "paths-info")
        if repo is None:
            return
        match self.command, rest:
            case "GET", []:
                self._info(name, repo, "main")
            case "GET", ["revision", revision]:
                self._info(name, repo, revision)
            case "GET", ["refs"]:
                self._json(
                    {
                        "branches": [self._ref("heads", "main", repo.head)],
                        "tags": [self._ref("tags", *tag) for tag in repo.tags.items()],
                        "converts": [],
                    }
                )
            case "GET", ["tree", revision, *folder]:
                self._tree(repo, revision, "/".join(folder))
            case "POST", ["paths-info", revision]:
                self._paths(repo, revision)
            case "POST", ["preupload", "main"]:
                self._preupload(repo)
            case "POST", ["commit", "main"]:
                self._commit(name, repo)
            case "POST", ["tag", revision]:
                self._tag(repo, revision)
            case "DELETE", ["tag", tag]:
                del repo.tags[tag]
                self._json({})
            case _:
                self._unknown()

    @staticmethod
    def _ref(kind: str, name: str, oid: str) -> dict[str, str]:
        return {"name": name, "ref": f"refs/{kind}/{name}", "targetCommit": oid}

    def _at(self, repo: Repo, revision: str) -> str | None:
        oid = repo.resolve(revision)
        if oid is None:
            self._error(404, "RevisionNotFound", f"Invalid rev id: {revision}")
        return oid

    def _info(self, name: str, repo: Repo, revision: str) -> None:
        oid = self._at(repo, revision)
        if oid is not None:
            files = [{"rfilename": path} for path in sorted(repo.commits[oid])]
            self._json(
                {
                    "id": name,
                    "sha": oid,
                    "private": repo.private,
                    "gated": False,
                    "disabled": False,
                    "tags": [],
                    "downloads": 0,
                    "likes": 0,
                    "siblings": files,
                }
            )

    def _tree(self, repo: Repo, revision: str, folder: str) -> None:
        oid = self._at(repo, revision)
        if oid is None:
            return
        prefix = f"{folder}/" if folder else ""
        found: dict[str, dict[str, Any]] = {}
        for path, entry in sorted(repo.commits[oid].items()):
            if not path.startswith(prefix):
                continue
            parents = path[len(prefix) :].split("/")[:-1]
            for depth in range(1, len(parents) + 1):
                name = prefix + "/".join(parents[:depth])
                found.setdefault(name, {"type": "directory", "path": name, "size": 0, "oid": "0"})
            found[path] = entry.info(path)
        if folder and not found:
            self._error(404, "EntryNotFound", f"{folder} does not exist")
            return
        deep = self.query.get("recursive", "").lower() in ("true", "1")
        self._json([v for k, v in found.items() if deep or "/" not in k[len(prefix) :]])

    def _paths(self, repo: Repo, revision: str) -> None:
        oid = self._at(repo, revision)
        if oid is None:
            return
        asked = (
            json.loads(self.body or b"")["paths"]
            if "json" in self.headers.get("Content-Type", "")
            else parse_qs((self.body or b"").decode())["paths"]
        )
        files, found = repo.commits[oid], []
        for path in [asked] if isinstance(asked, str) else asked:
            if path in files:
                found.append(files[path].info(path))
            elif any(name.startswith(f"{path}/") for name in files):
                found.append({"type": "directory", "path": path, "size": 0, "oid": "0"})
        self._json(found)

    def _preupload(self, repo: Repo) -> None:
        files = repo.commits[repo.head]
        self._json(
            {
                "files": [
                    {
                        "path": file["path"],
                        "uploadMode": "lfs" if file["path"].endswith(LARGE) else "regular",
                        "shouldIgnore": False,
                        "oid": files[file["path"]].etag if file["path"] in files else None,
                    }
                    for file in json.loads(self.body or b"")["files"]
                ]
            }
        )

    def _batch(self, name: str) -> None:
        if self._repo(name, write=True) is None:
            return
        objects = []
        for asked in json.loads(self.body or b"")["objects"]:
            value = {"oid": asked["oid"], "size": asked["size"]}
            if asked["oid"] not in self.state.blobs:
                upload = {"href": f"{self.state.url}/lfs/{asked['oid']}", "header": {}}
                value["actions"] = {"upload": upload}
            objects.append(value)
        self._json({"transfer": "basic", "objects": objects})

    def _store(self, oid: str) -> None:
        if hashlib.sha256(self.body or b"").hexdigest() != oid:
            self._error(400, "", "checksum mismatch")
            return
        self.state.blobs[oid] = self.body or b""
        self._send(200, b"", {})

    def _commit(self, name: str, repo: Repo) -> None:
        files, message = dict(repo.commits[repo.head]), ""
        for line in (self.body or b"").splitlines():
            operation = json.loads(line)
            value = operation["value"]
            match operation["key"]:
                case "header":
                    message = f"{value['summary']}\n\n{value['description']}".strip()
                case "file":
                    assert value["encoding"] == "base64"
                    files[value["path"]] = Entry(base64.b64decode(value["content"]), False)
                case "lfsFile":
                    files[value["path"]] = Entry(self.state.blobs[value["oid"]], True)
                case "deletedFile":
                    del files[value["path"]]
                case _:
                    self._unknown()
                    return
        oid = repo.commit(files, message)
        self._json({"commitUrl": f"{self._url(name)}/commit/{oid}", "commitOid": oid})

    def _tag(self, repo: Repo, revision: str) -> None:
        oid, tag = self._at(repo, revision), json.loads(self.body or b"")["tag"]
        if oid is None:
            return
        if tag in repo.tags:
            self._error(409, "", f"Reference refs/tags/{tag} already exists")
            return
        repo.tags[tag] = oid
        self._json({})

    def _resolve(self, name: str, revision: str, path: str) -> None:
        repo = self._repo(name)
        oid = None if repo is None else self._at(repo, revision)
        if repo is None or oid is None:
            return
        entry = repo.commits[oid].get(path)
        if entry is None:
            self._error(404, "EntryNotFound", f"{path} does not exist")
            return
        headers = {
            "ETag": f'"{entry.etag}"',
            "X-Repo-Commit": oid,
            "X-Linked-Etag": f'"{entry.etag}"',
            "X-Linked-Size": str(len(entry.data)),
            "Accept-Ranges": "bytes",
        }
        data, status = entry.data, 200
        wanted = self.headers.get("Range")
        if wanted and self.command == "GET":
            first, _, last = wanted.removeprefix("bytes=").partition("-")
            end = min(int(last) + 1, len(data)) if last else len(data)
            headers["Content-Range"] = f"bytes {first}-{end - 1}/{len(data)}"
            data, status = data[int(first) : end], 206
        self._send(status, data, {**headers, "Content-Length": str(len(data))})
