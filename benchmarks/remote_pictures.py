"""How many bytes of pictures at URLs are moved to open a dataset, and to make a table's rows.

Serves one JPEG of 3 MB by HTTP on 127.0.0.1 under many names, by ranges of bytes and whole only,
and counts what is asked for: by opening a COCO file that does not say its pictures' sizes, and by
label_table. Needs aiohttp beside the extra remote.

Run: python benchmarks/remote_pictures.py [--pictures 200]
"""

import argparse
import json
import re
import tempfile
import threading
from collections import Counter
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from opening import NAMES
from PIL import ExifTags, Image

from animal3dbox.datasets import CocoKeypointsDataset
from animal3dbox.report import label_table

HW = (1920, 2560)
"""Height and width of the picture."""


def picture() -> bytes:
    """A JPEG of noise with a focal length in its header."""
    exif = Image.Exif()
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = 50
    content = BytesIO()
    pixels = np.random.default_rng(0).integers(0, 256, (*HW, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(content, "JPEG", quality=76, exif=exif)
    return content.getvalue()


class PictureServer(ThreadingHTTPServer):
    """Serves one picture under every name, and counts.

    Args:
        content: of the picture.
        knows_ranges: whether parts of it are sent where they are asked for.

    """

    def __init__(self, content: bytes, *, knows_ranges: bool) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.content, self.knows_ranges = content, knows_ranges
        self.counts = Counter[str]()
        threading.Thread(target=self.serve_forever, daemon=True).start()


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: PictureServer

    def do_HEAD(self) -> None:
        self._answer()

    def do_GET(self) -> None:
        self.wfile.write(self._answer())

    def _answer(self) -> bytes:
        """Send the head of an answer; gives its body, counted if it is asked for."""
        content, whole = self.server.content, self.server.content
        asked = re.fullmatch(r"bytes=(\d*)-(\d*)", self.headers.get("Range", ""))
        is_part = asked is not None and self.server.knows_ranges
        if asked is not None and is_part:
            first, last = asked.groups()
            content = (
                whole[int(first) : int(last or len(whole)) + 1] if first else whole[-int(last) :]
            )
        self.send_response(206 if is_part else 200)
        if is_part:
            begin = whole.find(content)
            self.send_header(
                "Content-Range", f"bytes {begin}-{begin + len(content) - 1}/{len(whole)}"
            )
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        is_get = self.command == "GET"
        self.server.counts.update(requests=1, bytes=len(content) if is_get else 0)
        return content

    def log_message(self, format: str, *arguments: Any) -> None:
        """Print nothing."""


def write_annotations(folder: Path, address: str, pictures: int) -> Path:
    """A COCO file of pictures at URLs, a dog in each, that does not say their sizes."""
    points = [number for k in range(len(NAMES)) for number in (400 + 60 * k, 500 + 37 * k % 300, 2)]
    places = range(1, pictures + 1)
    content = {
        "images": [{"id": k, "file_name": f"{address}/{k}.jpg"} for k in places],
        "annotations": [
            {
                **{"id": k, "image_id": k, "category_id": 1, "iscrowd": 0, "keypoints": points},
                "bbox": [300, 400, 1200, 600],
            }
            for k in places
        ],
        "categories": [{"id": 1, "name": "dog", "keypoints": [*NAMES]}],
    }
    file = folder / "annotations.json"
    file.write_text(json.dumps(content))
    (folder / "images").mkdir()
    return file


def measure(pictures: int, *, knows_ranges: bool) -> None:
    """Print what opening and making rows move."""
    content = picture()
    server = PictureServer(content, knows_ranges=knows_ranges)
    words = "ranges" if knows_ranges else "no ranges"
    print(f"{words}: {pictures} pictures of {len(content) / 1e6:.2f} MB")
    with tempfile.TemporaryDirectory() as folder:
        address = f"http://127.0.0.1:{server.server_port}"
        file = write_annotations(Path(folder), address, pictures)
        dataset = CocoKeypointsDataset(
            file, images=Path(folder) / "images", body="preset", on_bad="skip"
        )
        print_counts("open", server)
        status = Counter(label_table(dataset, range(len(dataset)))["status"])
        print_counts("label_table", server)
    print(f"  {dict(status)}")
    server.shutdown()


def print_counts(name: str, server: PictureServer) -> None:
    """Print what a server has been asked for since the last time."""
    counts = server.counts
    print(f"  {name}: {counts['bytes'] / 1e6:.1f} MB in {counts['requests']} requests", flush=True)
    counts.clear()


def main() -> None:
    """Measure with a server that knows ranges, and with one that knows none."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--pictures", type=int, default=200)
    options = parser.parse_args()
    for knows_ranges in (True, False):
        measure(options.pictures, knows_ranges=knows_ranges)


if __name__ == "__main__":
    main()
