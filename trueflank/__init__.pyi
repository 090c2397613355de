from drivers.errors import TrueflankError as TrueflankError
from trueflank import interferometer as interferometer
from trueflank.benches import DriveTest as DriveTest
from trueflank.benches import EvaluatedDrive as EvaluatedDrive
from trueflank.benches import read_bench as read_bench
from trueflank.drives import Drive as Drive
from trueflank.drives import Matched as Matched
from trueflank.drives import Reducer as Reducer
from trueflank.drives import match as match
from trueflank.drives import transmission as transmission
from trueflank.kinematics import FrameOf as FrameOf
from trueflank.kinematics import RelativeError as RelativeError
from trueflank.kinematics import RelativeErrors as RelativeErrors
from trueflank.measuring import ErrorMotion as ErrorMotion
from trueflank.measuring import Evaluated as Evaluated
from trueflank.measuring import Measured as Measured
from trueflank.measuring import evaluate as evaluate
from trueflank.measuring import fit as fit
from trueflank.measuring import read as read
from trueflank.measuring import report as report
from trueflank.studies import Corrected as Corrected
from trueflank.studies import Ranking as Ranking
from trueflank.studies import Study as Study
from trueflank.studies import correct as correct
from trueflank.studies import rank as rank
from trueflank.studies import study as study
from trueflank.surfaces import Contact as Contact
from trueflank.surfaces import Profile as Profile
from trueflank.surfaces import Surface as Surface
from trueflank.surfaces import Wheel as Wheel
from trueflank.tooth import Flank as Flank
from trueflank.tooth import Gear as Gear
from trueflank.tooth import Machine as Machine
from trueflank.tooth import contact as contact
from trueflank.tooth import flank as flank

HOMES: dict[str, tuple[str, ...]]
__version__: str
