from voxgran.clumps.fit import fit_clump as fit_clump
from voxgran.clumps.methods.inscribed import Inscribed as Inscribed
from voxgran.clumps.model import Clump as Clump
