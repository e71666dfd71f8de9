import preact from "@preact/preset-vite";
import { defineConfig } from "vite";

// The built page is embedded in the program and committed: fixed names, three files.
export default defineConfig({
  base: "./",
  plugins: [preact()],
  // Stores of Sunstone use none of these codecs, whose WebAssembly would be 1.4 MB of the page.
  resolve: { alias: [{ find: /^numcodecs\/(blosc|lz4|zstd)$/, replacement: "/src/sources/static/unused_codec.ts" }] },
  build: {
    outDir: "../built",
    emptyOutDir: true,
    target: "es2023",
    modulePreload: false,
    rollupOptions: {
      output: { entryFileNames: "app.js", assetFileNames: "app.[ext]", codeSplitting: false },
    },
  },
});
