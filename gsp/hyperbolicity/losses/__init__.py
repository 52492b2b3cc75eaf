"""Losses of normal hyperbolicity: located, named, and with what follows from each."""

from gsp.hyperbolicity.losses.diagnosis import Diagnosis as Diagnosis
from gsp.hyperbolicity.losses.ends import ends_on_grid as ends_on_grid
from gsp.hyperbolicity.losses.ends import sheet_ends as sheet_ends
from gsp.hyperbolicity.losses.examination import examine as examine
from gsp.hyperbolicity.losses.kinds import Loss as Loss
from gsp.hyperbolicity.losses.kinds import LossKind as LossKind
from gsp.hyperbolicity.losses.locator import Locator as Locator
from gsp.hyperbolicity.losses.roots import gauss_newton as gauss_newton
from gsp.hyperbolicity.losses.whole_branch import singular_points as singular_points
