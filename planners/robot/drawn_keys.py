"""The keys of drawn-up legs in a course's file: their servo."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

from ..errors import InvalidInput
from ..files.arrays import LARGEST
from .servo import Servo

Above = Annotated[float, Field(gt=0.0, le=LARGEST)]
Angle = Annotated[float, Field(ge=-10.0, le=10.0)]
Angles = tuple[Angle, Angle, Angle, Angle]


class DrawnLegsKeys(BaseModel):
    """Legs of four joints, drawn up for every limb, and the servo at each of their joints, see ``Servo``."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)
    torque_nm: Above = Servo.torque_nm
    velocity_rad_s: Above = Servo.velocity_rad_s
    lower_rad: Angles = Servo.lower_rad
    upper_rad: Angles = Servo.upper_rad
    stiffness_nm_rad: Above = Servo.stiffness_nm_rad
    damping_nms_rad: Above = Servo.damping_nms_rad
    rotor_kg_m2: Annotated[float, Field(ge=0.0, le=LARGEST)] = Servo.rotor_kg_m2

    @model_validator(mode="after")
    def _agree(self) -> DrawnLegsKeys:
        try:
            self.servo()
        except InvalidInput as error:
            raise InvalidInput(str(error).replace("servo.", "")) from None
        return self

    def servo(self) -> Servo:
        """The same as a robot has it."""
        return Servo(**self.model_dump())
