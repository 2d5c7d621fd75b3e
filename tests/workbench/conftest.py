"""What tests of explorers share."""

import gc

import pytest


@pytest.fixture
def only_new_rubbish():
    """What was there before is not looked through at every collection: that is most of its time."""
    gc.freeze()
    yield
    gc.unfreeze()
