/** Colour maps, as tables of 256 RGB colours. The tables of signed and positive values are those of `sunstone figure`. */

/** 256 colours of three bytes each. */
export type ColourMap = Uint8Array;

/** Colour of values that are not defined, such as a quotient by 0, as little-endian RGBA: grey 178. */
export const UNDEFINED_RGBA = 0xffb2b2b2;

/** Matplotlib's inferno (van der Walt and Smith), perceptually uniform. */
const INFERNO =
  "00000401000501010601010802010a02020c02020e03021004031204031405041706041907051b08051d09061f0a07220b07240c08260d08290e092b" +
  "10092d110a30120a32140b34150b37160b39180c3c190c3e1b0c411c0c431e0c451f0c48210c4a230c4c240c4f260c51280b53290b552b0b572d0b59" +
  "2f0a5b310a5c320a5e340a5f3609613809623909633b09643d09653e0966400a67420a68440a68450a69470b6a490b6a4a0c6b4c0c6b4d0d6c4f0d6c" +
  "510e6c520e6d540f6d550f6d57106e59106e5a116e5c126e5d126e5f136e61136e62146e64156e65156e67166e69166e6a176e6c186e6d186e6f196e" +
  "71196e721a6e741a6e751b6e771c6d781c6d7a1d6d7c1d6d7d1e6d7f1e6c801f6c82206c84206b85216b87216b88226a8a226a8c23698d23698f2469" +
  "9025689225689326679526679727669827669a28659b29649d29649f2a63a02a63a22b62a32c61a52c60a62d60a82e5fa92e5eab2f5ead305dae305c" +
  "b0315bb1325ab3325ab43359b63458b73557b93556ba3655bc3754bd3853bf3952c03a51c13a50c33b4fc43c4ec63d4dc73e4cc83f4bca404acb4149" +
  "cc4248ce4347cf4446d04545d24644d34743d44842d54a41d74b3fd84c3ed94d3dda4e3cdb503bdd513ade5238df5337e05536e15635e25734e35933" +
  "e45a31e55c30e65d2fe75e2ee8602de9612bea632aeb6429eb6628ec6726ed6925ee6a24ef6c23ef6e21f06f20f1711ff1731df2741cf3761bf37819" +
  "f47918f57b17f57d15f67e14f68013f78212f78410f8850ff8870ef8890cf98b0bf98c0af98e09fa9008fa9207fa9407fb9606fb9706fb9906fb9b06" +
  "fb9d07fc9f07fca108fca309fca50afca60cfca80dfcaa0ffcac11fcae12fcb014fcb216fcb418fbb61afbb81dfbba1ffbbc21fbbe23fac026fac228" +
  "fac42afac62df9c72ff9c932f9cb35f8cd37f8cf3af7d13df7d340f6d543f6d746f5d949f5db4cf4dd4ff4df53f4e156f3e35af3e55df2e661f2e865" +
  "f2ea69f1ec6df1ed71f1ef75f1f179f2f27df2f482f3f586f3f68af4f88ef5f992f6fa96f8fb9af9fc9dfafda1fcffa4";

/** Samples of Matplotlib's cyclic map twilight; both ends are equal. */
const TWILIGHT =
  "e2d9e2d6d7ddc2ced4aac2cc93b4c680a5c37297c16887be6276ba5f64b55e51ad5d3da1592a8f511b7745135c3811453014373a113a4a13425f174a" +
  "741e4f872750983550a64550b25652bb6958c27c63c78f72cca287d1b5a1d8c6bdded3d4e2d9e2";

/** ColorBrewer's RdBu, from blue to red. */
const RED_BLUE = "053061" + "2166ac" + "4393c3" + "92c5de" + "d1e5f0" + "f7f7f7" + "fddbc7" + "f4a582" + "d6604d" + "b2182b" + "67001f";

const bytes = (hex: string): Uint8Array =>
  Uint8Array.from({ length: hex.length / 2 }, (_, i) => parseInt(hex.slice(2 * i, 2 * i + 2), 16));

/** Interpolates control colours with a uniform cubic B-spline, as the crate `colorous` and D3 do. */
function basis(control: Uint8Array): ColourMap {
  const map = new Uint8Array(3 * 256);
  const last = control.length / 3 - 1;
  for (let k = 0; k < 256; k++) {
    const at = (k / 255) * last;
    const i = Math.min(Math.floor(at), last - 1);
    const t = at - i;
    for (let c = 0; c < 3; c++) {
      const v1 = control[3 * i + c];
      const v2 = control[3 * (i + 1) + c];
      const v0 = i > 0 ? control[3 * (i - 1) + c] : 2 * v1 - v2;
      const v3 = i < last - 1 ? control[3 * (i + 2) + c] : 2 * v2 - v1;
      const [t2, t3] = [t * t, t * t * t];
      const sum = (1 - 3 * t + 3 * t2 - t3) * v0 + (4 - 6 * t2 + 3 * t3) * v1 + (1 + 3 * t + 3 * t2 - 3 * t3) * v2 + t3 * v3;
      map[3 * k + c] = Math.max(0, Math.min(255, Math.floor(sum / 6)));
    }
  }
  return map;
}

/** Interpolates control colours linearly. */
function linear(control: Uint8Array): ColourMap {
  const map = new Uint8Array(3 * 256);
  const last = control.length / 3 - 1;
  for (let k = 0; k < 256; k++) {
    const at = (k / 255) * last;
    const i = Math.min(Math.floor(at), last - 1);
    for (let c = 0; c < 3; c++) {
      const [low, high] = [control[3 * i + c], control[3 * (i + 1) + c]];
      map[3 * k + c] = Math.round(low + (at - i) * (high - low));
    }
  }
  return map;
}

/** Positive values: black for 0, pale yellow for 1. */
export const sequential: ColourMap = bytes(INFERNO);
/** Signed values: blue for -1, nearly white for 0, red for +1. Safe for colour-blind users. */
export const diverging: ColourMap = basis(bytes(RED_BLUE));
/** Angles: both ends of the range have the same colour. */
export const cyclic: ColourMap = linear(bytes(TWILIGHT));

/** Returns a map as little-endian RGBA, one number a colour. */
export const packed = (map: ColourMap): Uint32Array =>
  Uint32Array.from({ length: 256 }, (_, k) => (0xff000000 | (map[3 * k + 2] << 16) | (map[3 * k + 1] << 8) | map[3 * k]) >>> 0);
