"""Motion capture, station and recorder in a few words each. Pure."""

from contract.messages import LogEntry, MocapHealth
from groundstation.mocap_words import figures, short
from groundstation.page_reasons import SILENT_S

RECORDER_SILENT_S = 15.0


def health(
    mocap: MocapHealth | None, frame_age_s: float, station: bool, recorder: LogEntry | None, recorder_age_s: float
) -> list[tuple[str, str]]:
    """(words, level) of motion capture, station and recorder."""
    if mocap is None or not 0 <= frame_age_s <= SILENT_S:
        parts = [("Mocap no frames", "warning")]
    else:
        words = ", ".join(filter(None, (f"Mocap {figures(mocap)}", short(mocap))))
        parts = [(words, "info" if mocap.state == "ok" else "warning")]
    parts.append(("Station ok", "info") if station else ("Station silent", "warning"))
    if recorder is None or recorder_age_s > RECORDER_SILENT_S:
        parts.append(("Recording off", "info" if recorder is None else "warning"))
    else:
        size = recorder.fields.get("bytes")
        words = f"Recording {float(size) / 1e6:.0f} MB" if isinstance(size, int | float) else "Recording"
        parts.append((words if recorder.level == "info" else recorder.text[:60], recorder.level))
        free, rate = recorder.fields.get("disk_free_bytes"), recorder.fields.get("bytes_per_s")
        if isinstance(free, int | float) and isinstance(rate, int | float) and rate > 0:
            hours = free / rate / 3600
            parts.append((f"Disk {hours:.1f} h left" if hours < 1000 else "Disk ample", recorder.level))
    return parts
