"""Names for notebooks and scripts: machine, trials, campaigns, lines, planter and FX programs (docs/notebooks.md).

Everything here is defined, with its documentation, in the module from which it comes.
"""

from controller.fx.language.il import read_il
from controller.fx.language.reading import load_ladder
from controller.program.states import State
from plant_sim.faults import parse_fault
from plant_sim.line.command import line_result
from plant_sim.line.result import LineResult
from plant_sim.machine.parameters import Machine, load_machine
from plant_sim.planter.motion import Motion
from plant_sim.planter.parameters import load_planter
from plant_sim.planter.report import MotionReport
from plant_sim.study.campaign.frame import campaign_frame, trial_frame
from plant_sim.twin.ending.rule import EndingRule
from plant_sim.twin.ladder.trial import LadderReport, run_ladder_trial
from plant_sim.twin.lock_step import NotReachedError, Twin
from plant_sim.twin.report import TrialReport
from plant_sim.twin.trial import run_trial

__all__ = [
    "EndingRule",
    "LadderReport",
    "LineResult",
    "Machine",
    "Motion",
    "MotionReport",
    "NotReachedError",
    "State",
    "TrialReport",
    "Twin",
    "campaign_frame",
    "line_result",
    "load_ladder",
    "load_machine",
    "load_planter",
    "parse_fault",
    "read_il",
    "run_ladder_trial",
    "run_trial",
    "trial_frame",
]
