"""The one door for CSV files that people bring: read right, or refused in one line."""

from losbench.tables.dialect import Dialect as Dialect
from losbench.tables.moments import Moments as Moments
from losbench.tables.table import Table as Table
from losbench.tables.table import read_table as read_table
