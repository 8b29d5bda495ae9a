// A coarse picture at the pixels of one twice as fine: output 2i lies a quarter step before coarse i, 2i + 1 a quarter step behind.
fn doubled_at(which: texture_2d<f32>, pixel: vec2i) -> vec3f {
    let last = vec2i(textureDimensions(which)) - 1;
    let near = min(pixel / 2, last);
    let far = clamp(near + select(vec2i(1), vec2i(-1), pixel % 2 == vec2i(0)), vec2i(0), last);
    let here = 0.75 * textureLoad(which, near, 0).xyz + 0.25 * textureLoad(which, vec2i(far.x, near.y), 0).xyz;
    let there = 0.75 * textureLoad(which, vec2i(near.x, far.y), 0).xyz + 0.25 * textureLoad(which, far, 0).xyz;
    return 0.75 * here + 0.25 * there;
}
