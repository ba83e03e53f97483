// What is not defined is found by types (jsconfig.json), for the pages' scripts.
import js from "@eslint/js";

export default [
  { ignores: [".venv/", "data/", "out/", "web/static/js/film/mediabunny.js"] },
  { files: ["web/static/**/*.js", "tests/web/js/*.js"], ...js.configs.recommended },
  {
    rules: {
      "no-undef": "off",
      "no-empty": ["error", { allowEmptyCatch: true }],
      "no-shadow": "error",
      "no-var": "error",
      "prefer-const": "error",
      "object-shorthand": "error",
      "prefer-template": "error",
      "no-throw-literal": "error",
      "no-unused-expressions": "error",
      "no-implicit-coercion": "error",
      "no-else-return": "error",
      "no-useless-return": "error",
      "no-loop-func": "error",
      "no-eval": "error",
      "no-implied-eval": "error",
      "no-new-func": "error",
      "no-script-url": "error",
      // Prettier breaks code at 100 columns, but neither comments nor texts.
      "max-len": ["error", { code: 100 }],
      eqeqeq: ["error", "always", { null: "ignore" }],
    },
    linterOptions: { reportUnusedDisableDirectives: "error" },
  },
  {
    // Titles of tests and texts that tests expect stay in one piece, so that a search finds them.
    files: ["tests/web/js/*.js"],
    rules: {
      "max-len": [
        "error",
        {
          code: 100,
          ignoreStrings: true,
          ignoreTemplateLiterals: true,
          ignoreRegExpLiterals: true,
        },
      ],
    },
  },
];
