"""Losses of normal hyperbolicity: located, named, and with what follows from each."""

from gsp.losses.diagnosis import Diagnosis as Diagnosis
from gsp.losses.ends import sheet_ends as sheet_ends
from gsp.losses.examination import examine as examine
from gsp.losses.kinds import Loss as Loss
from gsp.losses.kinds import LossKind as LossKind
from gsp.losses.locator import Locator as Locator
from gsp.losses.newton import gauss_newton as gauss_newton
from gsp.losses.whole_branch import singular_points as singular_points
