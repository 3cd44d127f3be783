"""What is asked for and heard on the links of a mission, by a pilot and by a survey."""

from collections.abc import Collection

from pymavlink.dialects.v20 import all as dialect

from circnav_mav.mav.codec import Decoder
from circnav_mav.mav.ranging.table import RANGING_MESSAGES
from circnav_mav.mav.signing import Signing
from circnav_mav.pilot.settings import LINKS, PilotSettings

AUTOPILOT_COMPONENT = 1
HOME_RATE = 1.0
"""Rate, Hz, of HOME_POSITION where the height counts from home, which may be set anew until the engagement."""


def more_streams(settings: PilotSettings) -> dict[int, float]:
    """Streams to ask for beside the adapter's, message id -> Hz: ranges that the autopilot sends, and home."""
    message, streams = RANGING_MESSAGES[settings.ranging.message], {}
    if settings.ranging.component == AUTOPILOT_COMPONENT and not settings.ranging_apart:
        streams[message.id] = settings.ranging.rate
    if settings.height.target_above_home is not None:
        streams[dialect.MAVLINK_MSG_ID_HOME_POSITION] = HOME_RATE
    return streams


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
