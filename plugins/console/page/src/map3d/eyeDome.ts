// Eye-dome lighting (Boucheny 2009): a point that lies behind its neighbours in the picture is darker, so that edges
// are seen where the points have no shade of their own.

import {
  AlwaysDepth,
  DepthTexture,
  FloatType,
  GLSL3,
  Mesh,
  OrthographicCamera,
  type PerspectiveCamera,
  PlaneGeometry,
  Scene,
  ShaderMaterial,
  Vector2,
  type WebGLRenderer,
  WebGLRenderTarget,
} from "three";

const STRENGTH = 45; // of a step back by twice the distance
const AROUND = 8; // neighbours of a pixel
const DARKEST = 0.22;
const REACH_PX = 1.4;

const NEIGHBOURS = Array.from({ length: AROUND }, (_, i) => {
  const angle = (2 * Math.PI * i) / AROUND;
  return `vec2(${Math.cos(angle).toFixed(6)}, ${Math.sin(angle).toFixed(6)})`;
});

const VERTEX = `
  out vec2 place;
  void main() {
    place = uv;
    gl_Position = vec4(position.xy, 0.0, 1.0);
  }
`;

const FRAGMENT = `
  precision highp float;
  in vec2 place;
  uniform sampler2D picture, depths;
  uniform vec2 pixel, range;
  layout(location = 0) out highp vec4 colour;

  float nearness(float depth) { // proportional to 1 / distance along the camera's axis
    return range.y - depth * (range.y - range.x);
  }

  // How many times further away than a neighbour. The ground, at depth 1, is behind everything.
  float behind(vec2 off, float nearer) {
    return max(1.0, nearness(texture(depths, place + pixel * off).r) * nearer);
  }

  void main() {
    float depth = texture(depths, place).r;
    if (depth >= 1.0) discard; // the ground
    gl_FragDepth = depth; // what is laid over the cloud is hidden by it
    float own = 1.0 / nearness(depth);
    float times = ${NEIGHBOURS.map((off) => `behind(${off}, own)`).join(" * ")};
    // exp(-STRENGTH * mean of log2): one power for all neighbours, as software draws it on the processor
    colour = vec4(texture(picture, place).rgb * max(pow(times, ${(-STRENGTH / AROUND / Math.LN2).toFixed(4)}), ${DARKEST}), 1.0);
  }
`;

export class EyeDome {
  private readonly target = new WebGLRenderTarget(1, 1, { depthTexture: new DepthTexture(1, 1, FloatType) });
  private readonly material = new ShaderMaterial({
    glslVersion: GLSL3,
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    uniforms: {
      picture: { value: this.target.texture },
      depths: { value: this.target.depthTexture },
      pixel: { value: new Vector2() },
      range: { value: new Vector2() },
    },
    depthFunc: AlwaysDepth,
  });
  private readonly sheet = new Mesh(new PlaneGeometry(2, 2), this.material);
  private readonly scene = new Scene();
  private readonly camera = new OrthographicCamera();

  constructor(private readonly renderer: WebGLRenderer) {
    this.sheet.frustumCulled = false;
    this.scene.add(this.sheet);
  }

  /** Draws the cloud with its edges, and then what is laid over it. */
  render(cloud: Scene, over: Scene, camera: PerspectiveCamera): void {
    const { renderer, target, material } = this;
    const { width, height } = renderer.domElement;
    if (target.width !== width || target.height !== height) target.setSize(width, height);
    const reach = REACH_PX * Math.max(1, renderer.getPixelRatio());
    (material.uniforms.pixel!.value as Vector2).set(reach / width, reach / height);
    (material.uniforms.range!.value as Vector2).set(camera.near, camera.far);
    renderer.setRenderTarget(target);
    renderer.render(cloud, camera);
    renderer.setRenderTarget(null);
    renderer.render(this.scene, this.camera);
    renderer.autoClear = false;
    renderer.render(over, camera);
    renderer.autoClear = true;
  }

  dispose(): void {
    this.target.depthTexture?.dispose();
    this.target.dispose();
    this.material.dispose();
    this.sheet.geometry.dispose();
  }
}
