from drivers.errors import TrueflankError as TrueflankError
from trueflank.drives import Drive as Drive
from trueflank.drives import Matched as Matched
from trueflank.drives import Reducer as Reducer
from trueflank.drives import match as match
from trueflank.drives import transmission as transmission
from trueflank.measuring import ErrorMotion as ErrorMotion
from trueflank.measuring import Evaluated as Evaluated
from trueflank.measuring import Measured as Measured
from trueflank.measuring import evaluate as evaluate
from trueflank.measuring import fit as fit
from trueflank.measuring import read as read
from trueflank.measuring import report as report
from trueflank.studies import Corrected as Corrected
from trueflank.studies import Ranking as Ranking
from trueflank.studies import Studied as Studied
from trueflank.studies import correct as correct
from trueflank.studies import rank as rank
from trueflank.studies import study as study
from trueflank.tooth import Flank as Flank
from trueflank.tooth import Gear as Gear
from trueflank.tooth import Machine as Machine
from trueflank.tooth import flank as flank

MEASURING: tuple[str, ...]
TOOTH: tuple[str, ...]
DRIVES: tuple[str, ...]
STUDIES: tuple[str, ...]
