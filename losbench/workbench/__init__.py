"""The workbench: ledger and reproduction."""
