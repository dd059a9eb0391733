import preact from "@preact/preset-vite";
import { defineConfig } from "vite";

// Relative addresses only: the service may stand behind a proxy that puts a prefix before its paths.
export default defineConfig({
  base: "./",
  plugins: [preact()],
  build: {
    outDir: "../firstfix_console/files",
    emptyOutDir: true,
    license: { fileName: "notices.txt" }, // of the packages that the scripts hold
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
  },
});
