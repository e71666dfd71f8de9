"""The bridge to bluesky and ophyd-async: their devices as instruments of a session, and instruments as their devices.

A device is known by bluesky's protocols alone, so that neither library is needed here: `Movable` (``set`` gives a status), `Readable`,
`Locatable`, `Triggerable`, `Stoppable`; those of ophyd-async, whose methods are coroutines, as well.
"""

from pysunstone.rig.bluesky.devices import CameraOfDevice, StageOfDevice, event_loop
from pysunstone.rig.bluesky.plans import MovableProjector, MovableStage, ReadableCamera, Status
from pysunstone.rig.bluesky.scan_devices import CounterOfDevice, GalvoOfDevices, LaserOfDevices

__all__ = [
    "CameraOfDevice",
    "CounterOfDevice",
    "GalvoOfDevices",
    "LaserOfDevices",
    "MovableProjector",
    "MovableStage",
    "ReadableCamera",
    "StageOfDevice",
    "Status",
    "event_loop",
]
