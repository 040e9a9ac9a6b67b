"""PIPython, unmodified, in front of the emulated board: what a laboratory's program does with a controller.

Run by `cargo xtask check` in a virtual environment; its argument is the port of the board's serial line.
"""

import math
import sys
import time

from pipython import GCSDevice, GCSError, gcserror, pitools
from pipython.datarectools import Datarecorder, RecordOptions, TriggerSources
from pipython.pidevice.interfaces.pisocket import PISocket


def fails_with(code, action):
    """The controller answers an action with this error."""
    try:
        action()
    except GCSError as error:
        assert error.val == code, f"{error.val}, not {code}"
    else:
        raise AssertionError(f"no error {code}")


def wait(condition, seconds=60):
    """Until something is so, by the machine's clock: an emulated board may be slower than its hardware."""
    end = time.time() + seconds
    while not condition():
        assert time.time() < end, "it never becomes so"
        time.sleep(0.02)


def identifies(device):
    assert device.devname == "HYSTERON", device.devname
    assert device.qIDN().count(",") == 3
    assert device.axes == ["1"] and device.allaxes == ["1"]
    assert device.qCST()["1"], "a stage"
    for command in ("MOV", "qPOS", "SVO", "WSL", "WGO", "DRC", "qDRR", "IsMoving", "StopAll", "IsControllerReady", "qIDN"):
        assert getattr(device, f"Has{command}")(), command
    assert not device.HasFRF()


NOT_ARMED = 4001


def ask(device, question):
    """An answer as it is, for commands that PIPython has no name for."""
    return device.read(question).strip()


def arms(device):
    """Nothing moves before the self-test has shown that the sensor follows the drive."""
    assert ask(device, "ENV?").startswith("CHECKSUM="), "a safety envelope"
    assert ask(device, "ARM? 1") == "1=0"
    fails_with(NOT_ARMED, lambda: device.ATZ("1", 0))
    device.send("ARM 1 1")
    assert not device.IsControllerReady()
    pitools.waitonready(device)
    assert ask(device, "ARM? 1") == "1=1"


def moves(device):
    fails_with(gcserror.E5_PI_CNTR_MOVE_WITHOUT_REF_OR_NO_SERVO, lambda: device.MOV("1", 1.0))
    device.ATZ("1", 0)
    assert not device.IsControllerReady()
    pitools.waitonready(device)
    device.SVO("1", True)
    assert device.qSVO("1")["1"] is True
    device.VEL("1", 500.0)
    assert math.isclose(device.qVEL("1")["1"], 500.0)
    for target in (2.0, 6.5, 3.25):
        device.MOV("1", target)
        pitools.waitontarget(device, "1", timeout=60)
        assert math.isclose(device.qMOV("1")["1"], target)
        position = device.qPOS("1")["1"]
        assert abs(position - target) < 0.03, f"{position} um, not {target}"
    device.MVR("1", 0.5)
    pitools.waitontarget(device, "1", timeout=60)
    assert abs(device.qPOS("1")["1"] - 3.75) < 0.03
    assert device.qOVF("1")["1"] is False
    assert 0.0 < device.qVOL(1)[1] < 120.0
    fails_with(gcserror.E7_PI_CNTR_POS_OUT_OF_LIMITS, lambda: device.MOV("1", 1000.0))
    fails_with(gcserror.E2_PI_CNTR_UNKNOWN_COMMAND, lambda: device.send("ABC 1"))
    fails_with(gcserror.E15_PI_CNTR_INVALID_AXIS_IDENTIFIER, lambda: device.MOV("3", 1.0))


def plays_and_records(device):
    device.WAV_SIN_P(table=1, firstpoint=0, numpoints=200, append="X", center=100, amplitude=2.0, offset=3.0, seglength=200)
    pitools.writewavepoints(device, 2, [3.0 + 0.01 * nth for nth in range(40)], bunchsize=10)
    assert device.qWAV(1, 1)[1][1] == 200.0 and device.qWAV(2, 1)[2][1] == 40.0
    device.WSL(1, 1)
    device.WGC(1, 2)
    assert device.qWSL(1)[1] == 1 and device.qWGC(1)[1] == 2
    recorder = Datarecorder(device)
    recorder.options = [RecordOptions.COMMANDED_POSITION_1, RecordOptions.ACTUAL_POSITION_2]
    recorder.sources = ["1", "1"]
    recorder.trigsources = TriggerSources.DEFAULT_0
    recorder.samplefreq = 20000
    recorder.numvalues = 400
    # Where the wave begins, so that the servo has nothing to make up for.
    device.MOV("1", 3.0)
    pitools.waitontarget(device, "1", timeout=60)
    recorder.arm()
    device.WGO(1, 1)
    pitools.waitonwavegen(device, 1, timeout=60)
    header, (target, position) = recorder.getdata(timeout=60)
    assert header["NDATA"] == 400 and math.isclose(header["SAMPLE_TIME"], 50e-6), header
    assert abs(max(target) - 5.0) < 0.01 and abs(min(target) - 3.0) < 0.01, (min(target), max(target))
    worst = max(abs(a - b) for a, b in zip(target[200:], position[200:]))
    assert worst < 0.1, f"{worst} um"
    print(f"   wave of 2 um at 100 Hz: tracking error at most {1e3 * worst:.1f} nm in the second cycle")


def stops(device):
    device.MOV("1", 8.0)
    fails_with(gcserror.E10_PI_CNTR_STOP, device.StopAll)
    assert device.qSVO("1")["1"] is False
    wait(lambda: abs(device.qVOL(1)[1]) < 0.1)
    device.STP(noraise=True)
    assert device.qERR() == 0


def leaves_a_finished_wave_alone(device):
    """The points of a wave that has ended are written anew, and the stage stays where it is."""
    device.MOV("1", 3.0)
    pitools.waitontarget(device, "1", timeout=60)
    device.WGC(1, 1)
    device.WGO(1, 1)
    pitools.waitonwavegen(device, 1, timeout=60)
    before = device.qPOS("1")["1"]
    device.WAV_LIN(table=1, firstpoint=0, numpoints=200, append="X", speedupdown=0, amplitude=0.0, offset=9.0, seglength=200)
    time.sleep(0.2)
    assert device.qSVO("1")["1"] is True
    assert abs(device.qPOS("1")["1"] - before) < 0.05, f"{before} um and {device.qPOS('1')['1']} um"


def disarms(device):
    """The power stage is switched off, and no fault has been latched in all of it."""
    device.send("ARM 1 0")
    wait(lambda: ask(device, "ARM? 1") == "1=0")
    assert ask(device, "LOG?") == "NONE"


def main():
    # The device closes its connection when it is dropped; closing it before as well would close it twice.
    device = GCSDevice(gateway=PISocket("127.0.0.1", int(sys.argv[1])))
    for step in (identifies, arms, moves, plays_and_records, leaves_a_finished_wave_alone, stops, disarms):
        begin = time.time()
        step(device)
        print(f"   {step.__name__}: {time.time() - begin:.1f} s")


main()
