"""The chain of evidence: which files a result follows from, and whether they are whole.

Files name each other by SHA-256: a certificate its data, an arm file the campaign, the
design and the covariance that it comes from, a campaign the arm file that it was read
with, a recording the files in it. A name that no file beside them has is missing.
"""

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from traverse.kinematics.arm_file.arm import Arm, arm_digest, parse_arm, read_arm
from traverse.lab.acceptance.administration import standards_used
from traverse.lab.acceptance.certificate.check import CERTIFICATE, DATA, PAGES
from traverse.lab.campaign.campaign import campaign_digest
from traverse.lab.campaign.campaign_file import CampaignFile, read_campaign_file
from traverse.lab.identification.results.files import (
    IDENTIFICATION,
    IDENTIFICATION_FILES,
)
from traverse.lab.measured_points.reading import files_read
from traverse.lab.report.provenance import SUMS, digest_of_files, sums_problems
from traverse.protocol.signed_points import checked_points, points_of_lines
from traverse.recording.reader import read_recording
from traverse.recording.run_reader import RunReader
from traverse.strict_toml.files import json_of, text_lines
from traverse.strict_toml.problems import FileError, toml_table, toml_text

State = Literal["whole", "altered", "missing", "not stated"]
# Of the folders in which files are looked for.
_MOST_ENTRIES = 20_000
_MOST_DEEP = 4
DCC = "dcc.xml"
_RESULTS = (CERTIFICATE, IDENTIFICATION, DCC, SUMS)


@dataclass(slots=True)
class Link:
    """One file of a chain, and what it follows from.

    Attributes:
        what: For example "arm file demo-7".
        path: Where it is; None where it is missing.
        sha256: By which others name it, of an arm of its values; None: by nobody.
        remarks: What is wrong with it, or what it does not state.
    """

    what: str
    path: Path | None = None
    sha256: str | None = None
    state: State = "whole"
    remarks: list[str] = field(default_factory=list)
    links: list["Link"] = field(default_factory=list)

    def every(self) -> Iterator["Link"]:
        """This one, and all that it follows from."""
        yield self
        for link in self.links:
            yield from link.every()

    def alter(self, *remarks: str) -> "Link":
        """State that it is not as it was written, and why."""
        self.state = "altered"
        self.remarks += remarks
        return self

    @property
    def values(self) -> dict[str, Any]:
        """Plain values, for JSON; paths are written as texts."""
        return asdict(self)

    def lines(self, depth: int = 0) -> Iterator[str]:
        """The tree for people: a line a file, indented below what follows from it."""
        digest = f", SHA-256 {self.sha256[:12]}" if self.sha256 else ""
        place = f" ({self.path})" if self.path else ""
        indent = "  " * depth
        yield f"{indent}{self.what}{place}{digest}: {self.state}"
        for remark in self.remarks:
            yield f"{indent}  - {remark}"
        for link in self.links:
            yield from link.lines(depth + 1)


class Tracer:
    """Walks chains.

    Args:
        folders: Where files are looked for, and below.
        public_key: Of the arm, by which points are checked; None: they are not.
    """

    def __init__(
        self, folders: Iterable[Path], public_key: bytes | None = None
    ) -> None:
        self._public_key = public_key
        self._folders = tuple(
            dict.fromkeys(Path(os.path.realpath(folder)) for folder in folders)
        )
        self._seen: set[str] = set()

    def trace(self, path: Path) -> Link:
        """Walk the chain from a file or a folder of results or of a campaign.

        Raises:
            FileError: It is nothing that a chain has.
        """
        folder = path if path.is_dir() else path.parent
        if path.is_dir() or path.name in _RESULTS:
            if (folder / CERTIFICATE).is_file():
                return self._verification(folder)
            if (folder / IDENTIFICATION).is_file():
                return self._identification(folder)
        if path.is_dir() and (folder / "campaign.toml").is_file():
            return self._campaign(folder)
        if (link := self._walked(path)) is not None:
            return link
        message = (
            "is neither a folder of results or of a campaign, nor an arm file, a "
            "recording (.mcap) or points (.jsonl)"
        )
        raise FileError(path, message)

    def _walked(self, path: Path) -> Link | None:
        """Walk the chain of a file by its kind; None: it follows from nothing."""
        if path.name == "campaign.toml" and path.is_file():
            return self._campaign(path.parent)
        if path.suffix == ".toml":
            return self._arm(read_arm(path), path)
        if path.suffix == ".mcap":
            return self._recording(path)
        return self._points(path) if path.suffix == ".jsonl" else None

    def _folder(self, what: str, folder: Path, named: Iterable[str]) -> Link:
        link = Link(what, folder)
        if not (folder / SUMS).is_file():
            link.remarks.append(f"no {SUMS}: pages and tables in it are not checked")
        elif problems := list(sums_problems(folder, named)):
            link.alter(*problems)
        if (folder / DCC).is_file():
            remark = "signature and figures are checked by `traverse verify --check`"
            link.remarks.append(f"has a certificate, {DCC}: {remark}")
        return link

    def _verification(self, folder: Path) -> Link:
        values = _table(folder / CERTIFICATE)
        title = values.get("title", "an unknown standard")
        link = self._folder(f"verification by {title}", folder, PAGES)
        stated = values.get("digest")
        files = stated.get("files") if isinstance(stated, Mapping) else None
        for name, digest in (files if isinstance(files, Mapping) else {}).items():
            link.links.append(self._file(folder / DATA / str(name), str(digest)))
        return link

    def _identification(self, folder: Path) -> Link:
        values = _table(folder / IDENTIFICATION)
        link = self._folder("identification", folder, IDENTIFICATION_FILES)
        arm = folder / "arm.toml"
        link.links.append(
            self._arm(read_arm(arm), arm)
            if arm.is_file()
            else Link(arm.name, state="missing")
        )
        source = values.get("provenance")
        campaign = source.get("campaign") if isinstance(source, Mapping) else None
        digest = campaign.get("sha256") if isinstance(campaign, Mapping) else None
        if digest not in self._seen:
            link.links.append(self._named("campaign", digest))
        return link

    def _file(self, path: Path, digest: str) -> Link:
        """A file whose bytes are named; what it follows from is walked."""
        if not path.is_file():
            return Link(path.name, None, digest, "missing")
        if digest_of_files([path]) != digest:
            remark = "its digest is not the one by which it is named"
            return Link(path.name, path, digest).alter(remark)
        # Other tables, of limits for example, are no arm files.
        leads_on = path.name in ("arm.toml", "campaign.toml") or path.suffix == ".mcap"
        link = self._walked(path) if leads_on else None
        return link or Link(path.name, path, digest)

    def _arm(self, arm: Arm, path: Path | None) -> Link:
        digest = arm_digest(arm)
        link = Link(f"arm file {arm.name}", path, digest)
        if digest in self._seen:
            return link  # it is in the tree already, with its origin
        self._seen.add(digest)
        source = arm.identification
        if source is None or source.campaign_digest is None:
            link.remarks.append("states no identification: it is a design")
            return link
        if source.covariance_file and source.covariance_digest and path is not None:
            beside = path.parent / source.covariance_file
            link.links.append(self._covariance(beside, source.covariance_digest))
        link.links.append(self._named("campaign", source.campaign_digest))
        link.links.append(self._named("design", source.design_digest))
        return link

    def _covariance(self, path: Path, digest: str) -> Link:
        if path.is_file():
            return self._file(path, digest)
        return self._named(path.name, digest)

    def _campaign(self, folder: Path) -> Link:
        file = read_campaign_file(folder / "campaign.toml")
        digests = _campaign_digests(folder / "campaign.toml", file)
        link = Link("campaign", folder, digests[0])
        self._seen.update(digests)
        for used in standards_used({each.id: each for each in file.artefacts}):
            number = used.certificate_number or "not stated"
            remark = f"{used.name}: certificate {number}, outside of this chain"
            link.remarks.append(remark)
        link.links.append(self._named("arm file", file.arm_digest))
        return link

    def _recording(self, path: Path) -> Link:
        link = Link("recording", path)
        text, tear = None, None
        try:
            with RunReader(path) as run:
                for _ in run:
                    pass
                text, tear = run.files.get("arm.toml"), run.tear
        except ValueError as error:
            try:
                recording = read_recording(path)  # of samples, not of a daemon
            except FileError:
                return link.alter(str(error))
            text, tear = recording.arm_text.encode(), recording.tear
        if tear is not None:
            link.alter(f"is not whole: {tear}")
        else:  # a file that is none may be endless
            link.sha256 = digest_of_files([path])
        if text is None:
            link.links.append(Link("arm file", state="not stated"))
        else:
            source = f"{path}: arm.toml"
            link.links.append(self._arm(parse_arm(text.decode(), source), None))
        return link

    def _points(self, path: Path) -> Link:
        with text_lines(path) as lines:
            points = list(points_of_lines(lines))
        link = Link("points", path)
        wrong = [point for point in points if isinstance(point, str)]
        read_points = [point for point in points if not isinstance(point, str)]
        signed = [point for point in read_points if point.signature is not None]
        if self._public_key is not None:
            wrong = checked_points(points, self._public_key).problems
        elif signed:
            remark = "signed, and not checked: name the arm's public key by --key"
            link.remarks.append(remark)
        if wrong:
            link.alter(*wrong)
        else:  # a file that is none may be endless
            link.sha256 = digest_of_files([path])
        models = dict.fromkeys(point.model for point in read_points)
        link.links += [self._named("arm file", model) for model in models]
        return link

    def _named(self, what: str, digest: object) -> Link:
        """Whatever has a digest, looked for in the folders."""
        if not isinstance(digest, str) or not digest:
            return Link(what, state="not stated")
        path = self._known.get(digest)
        if path is None:
            return Link(what, None, digest, "missing", ["name its folder by --in"])
        link = None if digest in self._seen else self._walked(path)
        return link or Link(what, path, digest)

    @cached_property
    def _known(self) -> dict[str, Path]:
        """Files of the folders by the digests that others name them by."""
        files: dict[str, Path] = {}
        for path in self._candidates():
            try:
                if path.name == "campaign.toml":
                    for digest in _campaign_digests(path, read_campaign_file(path)):
                        files.setdefault(digest, path)
                elif path.suffix == ".toml" and "joints" in toml_table(
                    toml_text(path), str(path)
                ):
                    files.setdefault(arm_digest(read_arm(path)), path)
                elif path.suffix == ".npz":
                    files.setdefault(digest_of_files([path]), path)
            except (FileError, OSError):
                continue  # whatever it is, it is not what is looked for
        return files

    def _candidates(self) -> Iterator[Path]:
        n_left = _MOST_ENTRIES
        for folder in self._folders:
            waiting = [(Path(folder), 0)]
            while waiting:
                place, depth = waiting.pop(0)
                try:
                    entries = sorted(place.iterdir())
                except OSError:
                    continue
                n_left -= len(entries)
                if n_left < 0:
                    return
                for entry in entries:
                    if entry.name.startswith(".") or entry.is_symlink():
                        continue
                    if entry.is_dir() and depth < _MOST_DEEP:
                        waiting.append((entry, depth + 1))
                    elif entry.suffix in (".toml", ".npz"):
                        yield entry


def _table(path: Path) -> Mapping[str, Any]:
    try:
        values = json_of(path)
    except ValueError as error:
        raise FileError(path, f"was altered: {error}") from error
    if not isinstance(values, Mapping):
        raise FileError(path, "was altered: it is no table")
    return values


def _campaign_digests(path: Path, file: CampaignFile) -> tuple[str, str]:
    """The digests by which arm files and reports name a campaign."""
    return campaign_digest(path, file), digest_of_files(files_read(path.parent))
