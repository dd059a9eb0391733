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
const DARKEST = 0.22;
const REACH_PX = 1.4;

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

  float away(float depth) { // log2 of the distance along the camera's axis
    return log2(range.x * range.y / (range.y - depth * (range.y - range.x)));
  }

  void main() {
    float depth = texture(depths, place).r;
    if (depth >= 1.0) discard; // the ground
    gl_FragDepth = depth; // what is laid over the cloud is hidden by it
    float own = away(depth);
    float behind = 0.0;
    for (int i = 0; i < 8; i++) {
      float angle = 0.785398 * float(i);
      float there = texture(depths, place + pixel * vec2(cos(angle), sin(angle))).r;
      if (there < 1.0) behind += max(0.0, own - away(there));
    }
    colour = vec4(texture(picture, place).rgb * max(exp(-${STRENGTH.toFixed(1)} * behind / 8.0), ${DARKEST}), 1.0);
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
