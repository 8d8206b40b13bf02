"""What happens in a simulated sweep."""

from __future__ import annotations

from dataclasses import dataclass

from sonocal.errors import InputError

__all__ = ["SweepOptions", "check_sweep"]


def check_sweep(frames: int, rate_hz: float, sigma_px: float, sigma_mm: float, **shares: float) -> None:
    """Refuse settings that no sweep has.

    Raises:
        InputError: there is no image, no rate, less noise than none, or a share of the images is none.
    """
    if frames < 1 or not rate_hz > 0:
        raise InputError(f"a sweep needs frames and a rate; got {frames} at {rate_hz} Hz")
    if not (sigma_px >= 0 and sigma_mm >= 0):
        raise InputError(f"noise cannot be negative; got {sigma_px} px and {sigma_mm} mm")
    for name, share in shares.items():
        if not 0 <= share <= 1:
            raise InputError(f"{name} is between 0 and 1; got {share}")


@dataclass(frozen=True)
class SweepOptions:
    """What happens in a sweep.

    Attributes:
        frames: how many images.
        rate_hz: images a second.
        sigma_px: of the image point about the needle along each axis: bending, refraction.
        sigma_mm: tracking noise of the needle's two ends along each axis.
        hidden_share: share of the images in which the needle does not show.
        dropout_share: share of the items without a valid pose.
        latency_s: how much later the tracker stamps an instant than the images do.
        compact, interfaces: bright things in view on average, beside the needle.
        overlay: whether text and a ruler are drawn over the image, as in a screen capture.
        seed: of everything random.
    """

    frames: int = 500
    rate_hz: float = 20.0
    sigma_px: float = 1.0
    sigma_mm: float = 1.0
    hidden_share: float = 0.2
    dropout_share: float = 0.0
    latency_s: float = 0.0
    compact: float = 2.0
    interfaces: float = 0.5
    overlay: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        shares = {"hidden_share": self.hidden_share, "dropout_share": self.dropout_share}
        check_sweep(self.frames, self.rate_hz, self.sigma_px, self.sigma_mm, **shares)
