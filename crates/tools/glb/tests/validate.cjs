// Says what Khronos' validator finds in a file: `NODE_PATH=node_modules node validate.cjs FILE`.
const fs = require("fs");
const validator = require("gltf-validator");

validator
  .validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])), { maxIssues: 50 })
  .then(({ issues }) => {
    console.log(`${issues.numErrors} errors, ${issues.numWarnings} warnings`);
    for (const one of issues.messages.filter((one) => one.severity < 2)) {
      console.log(`${one.code} at ${one.pointer}: ${one.message}`);
    }
    process.exitCode = issues.numErrors + issues.numWarnings > 0 ? 1 : 0;
  });
