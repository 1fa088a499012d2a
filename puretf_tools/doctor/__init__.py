"""Find faults in transforms, as the command `tf_doctor` does, and say what to do."""

from puretf_tools.doctor.checks import ERROR, Finding, INFO, WARNING
from puretf_tools.doctor.report import examine, examine_bag, Report

__all__ = ['ERROR', 'INFO', 'WARNING', 'Finding', 'Report', 'examine', 'examine_bag']
