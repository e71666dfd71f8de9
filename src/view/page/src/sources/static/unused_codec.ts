/** Replaces the WebAssembly codecs of `numcodecs`, which `zarrita` refers to and which stores of Sunstone do not use. */
export default null;
