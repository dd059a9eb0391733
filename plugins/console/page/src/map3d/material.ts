// How points are drawn: by height above the floor, intensity, storey or normal or in one colour, and only those of the slice.

import { Color, DataTexture, FloatType, GLSL3, RedFormat, ShaderMaterial, Vector2 } from "three";
import { token } from "../ui/token";
import { FLOOR_CELLS, type Floor } from "./floor";

export type Colouring = "height" | "intensity" | "storey" | "normal" | "plain";
const MODES: Record<Colouring, number> = { height: 0, intensity: 4, storey: 3, normal: 1, plain: 2 };
export const COLOURINGS = Object.keys(MODES) as Colouring[];
const OVERLAP = 1.1; // of a point over the gap to the next
const SMALLEST_PX = 1.6;
export const LARGEST_PX = 5; // of a point that is near, unless somebody asks for others
export const SIZES_PX = [2, 14] as const; // smallest and largest of that choice
const DARKEST_GREY = 0.16; // the ground is darker
const MAX_STOREYS = 32; // further ones have the colour of the last

const VERTEX = `
  in vec2 bend;
  in float shade;
  uniform int mode;
  uniform float size, ratio, edge, high, largest;
  uniform int storeys;
  uniform vec2 slice;
  uniform highp sampler2D ground; // the floor's grid: one of each storey, above each other
  uniform vec3 plain;
  uniform float floors[${MAX_STOREYS}];
  out vec3 tint;

  // Turbo, as a polynomial (Mikhailov, 2019).
  vec3 turbo(float x) {
    const vec4 r4 = vec4(0.13572138, 4.61539260, -42.66032258, 132.13108234);
    const vec4 g4 = vec4(0.09140261, 2.19418839, 4.84296658, -14.18503333);
    const vec4 b4 = vec4(0.10667330, 12.64194608, -60.58204836, 110.36276771);
    const vec2 r2 = vec2(-152.94239396, 59.28637943);
    const vec2 g2 = vec2(4.27729857, 2.82956604);
    const vec2 b2 = vec2(-89.90310912, 27.34824973);
    x = mix(0.08, 0.96, clamp(x, 0.0, 1.0)); // its darkest ends cannot be told from the ground
    vec4 v4 = vec4(1.0, x, x * x, x * x * x);
    vec2 v2 = v4.zw * v4.z;
    return vec3(dot(v4, r4) + dot(v2, r2), dot(v4, g4) + dot(v2, g2), dot(v4, b4) + dot(v2, b2));
  }

  float storeyOf(float z) {
    float storey = 0.0;
    for (int i = 1; i < storeys; i++) storey += step(floors[i], z);
    return storey;
  }

  // Between the middles of the floor's cells.
  float floorAt(vec3 at) {
    vec2 cell = clamp(at.xy / edge * ${FLOOR_CELLS}.0 - 0.5, 0.0, ${FLOOR_CELLS - 1}.0);
    ivec2 low = ivec2(cell);
    ivec2 next = min(low + 1, ${FLOOR_CELLS - 1});
    int row = int(min(storeyOf(at.z), float(textureSize(ground, 0).y / ${FLOOR_CELLS} - 1))) * ${FLOOR_CELLS};
    vec2 part = fract(cell);
    float near = mix(texelFetch(ground, ivec2(low.x, row + low.y), 0).r, texelFetch(ground, ivec2(next.x, row + low.y), 0).r, part.x);
    float far = mix(texelFetch(ground, ivec2(low.x, row + next.y), 0).r, texelFetch(ground, ivec2(next.x, row + next.y), 0).r, part.x);
    return mix(near, far, part.y);
  }

  // Neighbouring storeys are far apart on the wheel of colours.
  vec3 ofStorey(float storey) {
    return 0.55 + 0.4 * cos(6.2832 * (0.6 + 0.381966 * storey + vec3(0.0, 0.33, 0.67)));
  }

  vec3 unfolded(vec2 e) {
    vec3 n = vec3(e, 1.0 - abs(e.x) - abs(e.y));
    if (n.z < 0.0) n.xy = (1.0 - abs(n.yx)) * vec2(n.x < 0.0 ? -1.0 : 1.0, n.y < 0.0 ? -1.0 : 1.0);
    return normalize(n);
  }

  void main() {
    vec4 at = modelMatrix * vec4(position, 1.0);
    vec4 seen = viewMatrix * at;
    gl_Position = projectionMatrix * seen;
    if (at.z < slice.x || at.z > slice.y) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    gl_PointSize = clamp(size * ratio / -seen.z, ${SMALLEST_PX}, largest);
    bool known = bend.x > -0.9999 || bend.y > -0.9999; // (-128, -128): no normal
    float light = known ? 0.75 + 0.25 * abs(dot(unfolded(bend), normalize(vec3(0.3, 0.5, 0.8)))) : 0.9;
    if (mode == 0) tint = turbo((at.z - floorAt(at.xyz)) / high) * light;
    else if (mode == 1) tint = known ? abs(unfolded(bend)) : vec3(0.5);
    else if (mode == 4) tint = vec3(mix(${DARKEST_GREY}, 1.0, shade)); // even to the eye: sRGB nearly is
    else if (mode == 3) tint = ofStorey(storeyOf(at.z)) * light;
    else tint = plain * light;
  }
`;

const FRAGMENT = `
  precision highp float;
  in vec3 tint;
  layout(location = 0) out highp vec4 colour;
  void main() {
    vec2 off = gl_PointCoord - 0.5;
    if (dot(off, off) > 0.25) discard;
    colour = vec4(tint, 1.0);
  }
`;

export class PointMaterial extends ShaderMaterial {
  constructor() {
    super({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: {
        mode: { value: MODES.height },
        size: { value: 0.05 },
        ratio: { value: 500 },
        edge: { value: 1 },
        high: { value: 1 },
        ground: { value: groundOf(new Float32Array(FLOOR_CELLS ** 2)) },
        slice: { value: new Vector2(-1e9, 1e9) },
        plain: { value: new Color(token("points-plain")) },
        floors: { value: new Array<number>(MAX_STOREYS).fill(1e9) },
        storeys: { value: 1 },
        largest: { value: LARGEST_PX },
      },
    });
  }

  set colouring(colouring: Colouring) {
    this.uniforms.mode!.value = MODES[colouring];
  }

  get colouring(): Colouring {
    return COLOURINGS.find((one) => MODES[one] === this.uniforms.mode!.value)!;
  }

  /** What heights are counted from; `edge` is that of the cloud. */
  setFloor({ heights, high }: Floor, edge: number): void {
    this.ground.dispose();
    this.uniforms.ground!.value = groundOf(heights);
    this.uniforms.edge!.value = edge;
    this.uniforms.high!.value = high;
  }

  /** z at which each storey begins, from below. */
  set floors(z: number[]) {
    this.uniforms.floors!.value = Array.from({ length: MAX_STOREYS }, (_, i) => z[i] ?? 1e9);
    this.uniforms.storeys!.value = Math.min(z.length, MAX_STOREYS);
  }

  /** Lowest and highest z that is drawn. */
  set slice([low, high]: [number, number]) {
    (this.uniforms.slice!.value as Vector2).set(low, high);
  }

  get slice(): [number, number] {
    return (this.uniforms.slice!.value as Vector2).toArray();
  }

  /** Height of the picture in pixels over twice the tangent of half the angle of view. */
  set pixelsPerTangent(ratio: number) {
    this.uniforms.ratio!.value = ratio;
  }

  /** Pixels that a point has at most, however near it is. */
  set largestPx(px: number) {
    this.uniforms.largest!.value = px;
  }

  /** Metres between the points that are drawn next. */
  set spacing(m: number) {
    this.uniforms.size!.value = m * OVERLAP;
    this.uniformsNeedUpdate = true;
  }

  override dispose(): void {
    this.ground.dispose();
    super.dispose();
  }

  private get ground(): DataTexture {
    return this.uniforms.ground!.value as DataTexture;
  }
}

function groundOf(heights: Float32Array): DataTexture {
  const texture = new DataTexture(heights, FLOOR_CELLS, heights.length / FLOOR_CELLS, RedFormat, FloatType);
  texture.needsUpdate = true;
  return texture;
}
