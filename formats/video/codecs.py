"""Encoders of RGB and depth videos, and their settings.

Each uses one thread, since episodes run in parallel, and gives the same bytes for the same frames.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..core.errors import check_name
from .depth_codes import DEPTH_PIXEL_FORMAT

GROUP_OF_PICTURES = 2  # key frame distance, LeRobot's own choice


@dataclass(frozen=True)
class VideoCodec:
    """An encoder and its settings, in the terms in which LeRobot records them.

    Attributes:
        encoder: FFmpeg encoder name.
        canonical: codec name that a reader sees.
        pixel_format: FFmpeg pixel format.
        crf: constant rate factor.
    """

    encoder: str
    canonical: str
    pixel_format: str
    crf: int
    preset: str | int
    extra_options: Mapping[str, str | int] = field(default_factory=dict)

    def options(self) -> dict[str, str]:
        """Return the encoder's option dictionary as FFmpeg takes it."""
        options = {"g": GROUP_OF_PICTURES, "crf": self.crf, "preset": self.preset}
        return {k: str(v) for k, v in {**options, **self.extra_options}.items()}


# Measured at 256 × 256 on two rendered walks through a furnished house, one core, CRF 21: H.264
# ultrafast 0.55 and 0.61 ms, 9.7 and 10.7 kB a frame at 39.6 and 38.1 dB, SSIM 0.979 and 0.975;
# superfast 0.91 and 0.94 ms, 9.2 and 9.8 kB, 39.3 and 37.9 dB, 0.981 and 0.977; AV1 (LeRobot's
# default, preset 12, CRF 30) takes four times as long as superfast for half the bytes at 2.8 dB
# less. Noise textures cost more, but keep the order. CAVLC (coder 0) makes H.264 1.2 times as fast
# to write and 1.8 times as fast to read as CABAC does, for the same pixels and 6 % more bytes.
_FAST = {"bf": 0, "threads": 1, "coder": 0}
_AV1 = {"svtav1-params": "fast-decode=0:lp=1"}
RGB_CODECS: dict[str, VideoCodec] = {
    "h264": VideoCodec("h264", "h264", "yuv420p", 21, "ultrafast", _FAST),
    "av1": VideoCodec("libsvtav1", "av1", "yuv420p", 30, 12, _AV1),
}


def check_rgb_codec(name: str) -> None:
    """Raise UnknownNameError unless `name` is in `RGB_CODECS`."""
    check_name("video codec", name, RGB_CODECS)


# Pictures to be looked at, not trained on, have B-frames. With these x264's macroblock tree reads
# memory that it never wrote, so that the same frames give other bytes; without it, and with CRFs 7
# higher, bytes and PSNR are the same within 4 % and 0.1 dB (a pan over a rendered room).
# For clips one key frame: a sixth of the bytes.
_WATCH = {"g": 50, "bf": 2, "threads": 1, "mbtree": 0}
_CLIP = {"g": 250, "bf": 2, "threads": 1, "tune": "animation", "mbtree": 0}
CLIP_CODEC = VideoCodec("h264", "h264", "yuv420p", 36, "medium", _CLIP)

# Whole episodes: finer than a clip, a key frame every other second.
WATCH_CODEC = VideoCodec("h264", "h264", "yuv420p", 30, "veryfast", _WATCH)

# Lossless 12-bit HEVC. Blocks of 16 instead of 64 pixels make lossless encoding 1.7 times as fast
# for 1 % more bytes (3.3 ms, 23 kB a frame), deciding by distortion alone (rd=1) 1.15 times as fast
# for 0.2 % more, and transforms of 8 pixels take 15 % off the bytes in the same time (4 pixels:
# 26 % in 1.2 times the time; blocks of 8: 32 % in 2.6 times). Most of the time is entropy coding:
# motion search, merging, checksums, intra frames alone change it by less than 5 %. FFV1 takes a
# third of the time and half the bytes, but no MP4 holds it, and LeRobot joins datasets into MP4.
# One thread per encoder: episodes run in parallel.
_LOSSLESS = (
    "lossless=1:ctu=16:max-tu-size=8:rd=1:bframes=0:scenecut=0:rc-lookahead=0"
    ":pools=none:frame-threads=1:info=0:log-level=none"
)
DEPTH_CODEC = VideoCodec(
    "hevc", "hevc", DEPTH_PIXEL_FORMAT, 30, "ultrafast", {"x265-params": _LOSSLESS}
)
