"""How the links of a mission are listened to, by a pilot and by a survey."""

from collections.abc import Collection

from circnav_mav.mav.codec import Decoder
from circnav_mav.mav.signing import Signing
from circnav_mav.pilot.settings import LINKS, PilotSettings


def decoders(settings: PilotSettings, wanted: Collection[int], signing: Signing | None) -> dict[str, Decoder]:
    """A decoder for each link. wanted: message ids worth decoding. signing: whom to believe, None for everybody."""
    return {
        link: Decoder(
            stream=link in settings.stream_links,
            wanted=wanted,
            signing=signing,
            accept_unsigned=link in settings.unsigned_links,
        )
        for link in LINKS
    }
