"""All kinds of observations, and what a file states of them."""

from __future__ import annotations

from lrm_ident.data.observations.distances import Distances
from lrm_ident.data.observations.encoder_readings import EncoderReadings
from lrm_ident.data.observations.observation import Observation
from lrm_ident.data.observations.orientations import Orientations
from lrm_ident.data.observations.positions import Positions

KINDS: tuple[type[Observation], ...] = (Positions, Orientations, EncoderReadings, Distances)
"""In the order of their rows: positions first."""
