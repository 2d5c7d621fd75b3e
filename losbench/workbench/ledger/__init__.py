"""The ledger: claims of the papers, what was found under which readings, and the verdicts of
rules.
"""

from losbench.workbench.ledger.claims import CLASSES as CLASSES
from losbench.workbench.ledger.claims import accepted_counts as accepted_counts
from losbench.workbench.ledger.entries import Value as Value
from losbench.workbench.ledger.ledger import Ledger as Ledger
from losbench.workbench.ledger.tables import with_accepted as with_accepted
from losbench.workbench.ledger.tracking import fields_read as fields_read
from losbench.workbench.ledger.tracking import watch as watch
