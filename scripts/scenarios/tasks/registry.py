"""All tasks by name, those of other packages included."""

from functools import cache

from models.registry import Registry
from scenarios.scenario import Task


@cache
def registry() -> Registry[Task]:
    """All tasks, those of other packages included."""
    kinds = {
        "SurfaceWork": "scenarios.tasks.surface_work:SurfaceWorkTask",
        "Tapping": "scenarios.tasks.tapping:TappingTask",
        "Insertion": "scenarios.tasks.insertion:InsertionTask",
        "Inspection": "scenarios.tasks.inspection:InspectionTask",
        "SeabedSampling": "scenarios.tasks.seabed_sampling:SeabedSamplingTask",
        "GearIdentification": "scenarios.arm_identification.friction_run:GearIdentificationTask",
    }
    return Registry("task", kinds)
