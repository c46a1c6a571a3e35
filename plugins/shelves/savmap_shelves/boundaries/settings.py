"""Parameters of the boundary detection; the published ones with the paper's values (section III.C)."""

from pydantic import BaseModel, ConfigDict, Field


class BoundarySettings(BaseModel):
    """How masks become edges and corners. Pixels refer to views of the default size, 640x480.

    - `least_upright`: uprights shorter than this share of the rack's height in the picture are dropped (paper: 5/8 of the
      picture's; of thin dark uprights a network often sees less).
    - `overlap`: a mask that shares more than this part of its area with a longer one is a duplicate.
    - `least_beam_px`: beams shorter than this are dropped; `least_aspect`: those less elongated, too.
    - `edge_tolerance_px`: how far a border may be from straight and still count for a line.
    - `end_trim_px`: the rounded ends of masks that no edge is fitted to.
    - `least_run_px`: masks that run on for less are no edge; `most_thick`: neither are parts so many times thicker than the rest.
    - `least_sigma_px`: no mask's edge is claimed to be better known than this, and `least_measured_sigma_px`: none that was
      measured in the panorama.
    - `along_sigma_px`: the standard deviation of an edge's ends along the edge.
    - `foot_margin_px`: an upright whose mask ends nearer to the frame's lower border has no foot; `foot_along_px`,
      `foot_across_px`: a foot's standard deviations.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    least_upright: float = Field(default=1 / 2, gt=0, le=1)
    overlap: float = Field(default=0.25, ge=0, le=1)
    least_beam_px: float = Field(default=20.0, gt=0)
    least_aspect: float = Field(default=1.5, ge=0)
    edge_tolerance_px: float = Field(default=1.0, gt=0)
    end_trim_px: float = Field(default=3.0, ge=0)
    least_run_px: int = Field(default=7, ge=1)
    most_thick: float = Field(default=3.0, gt=1)
    least_sigma_px: float = Field(default=0.3, gt=0)
    least_measured_sigma_px: float = Field(default=0.02, gt=0)
    along_sigma_px: float = Field(default=200.0, gt=0)
    foot_margin_px: float = Field(default=6.0, ge=0)
    foot_along_px: float = Field(default=3.0, gt=0)
    foot_across_px: float = Field(default=2.0, gt=0)
