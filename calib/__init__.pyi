from uuv.calib.arm_files import read_arm as read_arm
from uuv.calib.identification import Calibration as Calibration
from uuv.calib.identification import MapFit as MapFit
from uuv.calib.identification import identify as identify
from uuv.calib.loads import Loads as Loads
from uuv.calib.results import write_results as write_results
from uuv.calib.touch_files import read_touches as read_touches
from uuv.models.arms.serial_arm import SerialArm

Arm = SerialArm
