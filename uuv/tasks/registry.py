"""All tasks by name, those of other packages included."""

from functools import cache

from uuv.models.registry import Registry
from uuv.scenario import Task


@cache
def registry() -> Registry[Task]:
    """All tasks, those of other packages included."""
    kinds = {
        "SurfaceWork": "uuv.tasks.surface_work:SurfaceWorkTask",
        "Tapping": "uuv.tasks.tapping:TappingTask",
        "Insertion": "uuv.tasks.insertion:InsertionTask",
        "Inspection": "uuv.tasks.inspection:InspectionTask",
        "Collect": "uuv.tasks.collecting:CollectTask",
        "TurnValve": "uuv.tasks.turning:TurnValveTask",
        "MovePlug": "uuv.tasks.plugging:MovePlugTask",
        "SeabedSampling": "uuv.tasks.seabed_sampling:SeabedSamplingTask",
        "GearIdentification": "uuv.tasks.gear_identification:GearIdentificationTask",
        "StationKeeping": "uuv.tasks.station_keeping:StationKeepingTask",
    }

    # Those of other packages come with the registry.
    return Registry("task", kinds)
