// How sure a pose is, from the covariance of an answer: standard deviations, and the 95 % ellipse of the position.

const CHI2_95_2D = 5.991; // quantile of the chi-squared distribution with two degrees of freedom

export interface Ellipse {
  major_m: number; // half the long axis
  minor_m: number;
  angle_rad: number; // of the long axis, from the map's x axis to the left
}

/** Of the upper left 2 x 2 of a 6 x 6 covariance that is given row by row. */
export function ellipseOf(covariance: readonly number[]): Ellipse {
  const [xx, xy, yy] = [covariance[0]!, covariance[1]!, covariance[7]!];
  const middle = (xx + yy) / 2;
  const spread = Math.hypot((xx - yy) / 2, xy);
  const half = (variance: number) => Math.sqrt(CHI2_95_2D * Math.max(0, variance));
  return { major_m: half(middle + spread), minor_m: half(middle - spread), angle_rad: Math.atan2(2 * xy, xx - yy) / 2 };
}

export interface Deviations {
  x_m: number;
  y_m: number;
  z_m: number;
  heading_deg: number;
}

/** One standard deviation each, from the diagonal of a 6 x 6 covariance that is given row by row. */
export function deviationsOf(covariance: readonly number[]): Deviations {
  const at = (i: number) => Math.sqrt(Math.max(0, covariance[7 * i]!));
  return { x_m: at(0), y_m: at(1), z_m: at(2), heading_deg: (at(5) * 180) / Math.PI };
}
