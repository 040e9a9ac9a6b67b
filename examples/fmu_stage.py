"""A stage that is an FMU (FMI 2, co-simulation) as the plant of `hysteron track`; needs `pip install fmpy`.

    hysteron track model.toml servo.toml --reference sine:50:2 \
        --plant "python3 fmu_stage.py stage.fmu INPUT OUTPUT"

INPUT and OUTPUT are the names of the FMU's variables: drive in V, position in um.
"""

import os, shutil, sys
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

path, drive, reading = sys.argv[1:]
period_s = float(os.environ["HYSTERON_PERIOD_S"])
about, folder = read_model_description(path), extract(path)
number = {variable.name: variable.valueReference for variable in about.modelVariables}
unit = FMU2Slave(guid=about.guid, unzipDirectory=folder,
                 modelIdentifier=about.coSimulation.modelIdentifier, instanceName="stage")
unit.instantiate()
unit.setupExperiment(startTime=0.0)
unit.enterInitializationMode()
unit.exitInitializationMode()
time_s = 0.0
for line in sys.stdin:
    unit.setReal([number[drive]], [float(line)])
    unit.doStep(currentCommunicationPoint=time_s, communicationStepSize=period_s)
    time_s += period_s
    print(unit.getReal([number[reading]])[0], flush=True)
unit.terminate()
unit.freeInstance()
shutil.rmtree(folder)
