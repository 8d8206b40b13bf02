"""Videos with text tracks, as PLUS writes them."""

from fractions import Fraction

import pytest

MS = Fraction(1, 1000)
# What FFmpeg's writer of texts asks for and Matroska leaves out.
STYLES = b"[Script Info]\nScriptType: v4.00+\n[V4+ Styles]\nFormat: Name\n[Events]\nFormat: Layer, Start, End, Text\n"


def video_with_texts(path, pixels, tracks, rate=10):
    """Grey frames (N, V, U) without loss, and texts by track: name -> {time, s: text}."""
    av = pytest.importorskip("av", reason="PyAV is not installed")
    with av.open(str(path), "w") as container:
        video = container.add_stream("ffv1", rate=rate)
        video.height, video.width, video.pix_fmt = (*pixels.shape[1:], "gray")
        streams = {}
        for name in tracks:
            streams[name] = container.add_stream("subrip")
            if not hasattr(streams[name].codec_context, "subtitle_header"):
                pytest.skip("this PyAV writes no texts")
            streams[name].codec_context.subtitle_header = STYLES
            streams[name].metadata["title"] = name
            streams[name].time_base = MS
        for i, image in enumerate(pixels):
            frame = av.VideoFrame.from_ndarray(image, format="gray")
            frame.pts = i
            container.mux(video.encode(frame))
        container.mux(video.encode())
        for name, texts in tracks.items():
            for time, text in texts.items():
                packet = av.Packet(text.encode())
                packet.stream, packet.time_base, packet.duration = streams[name], MS, 1
                packet.pts = packet.dts = round(1000 * time)
                container.mux(packet)
