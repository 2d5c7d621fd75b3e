"""The ledger: claims of the papers, what was found, and the verdict of a rule."""

from losbench.workbench.ledger.verdicts import Ledger as Ledger
