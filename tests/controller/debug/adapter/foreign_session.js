// Session of the npm package @vscode/debugadapter-testsupport with a debug adapter. Usage: node foreign_session.js PLAN
// PLAN is a JSON object: {"script": "...", "launch": {...}, "orders": [["setBreakpoints", {...}], ["continue", {...}]]}.
// Instead of a shell script that starts the adapter, it can have a port. Output: the results of all orders, as JSON.
"use strict";

const { DebugClient } = require("@vscode/debugadapter-testsupport");

const plan = JSON.parse(process.argv[2]);
const RESUMING = new Set(["continue", "reverseContinue", "next", "stepIn", "stepOut", "stepBack", "goto", "pause"]);

async function run() {
    const client = new DebugClient("sh", plan.script, "fx");
    client.defaultTimeout = 60000;
    await client.start(plan.port);
    const results = [];
    await Promise.all([client.launch(plan.launch), client.configurationSequence(), client.waitForEvent("stopped")]);
    for (const [name, argument] of plan.orders) {
        const stopped = RESUMING.has(name) ? client.waitForEvent("stopped") : undefined;
        try {
            const response = await client.send(name, argument);
            results.push(stopped === undefined ? response.body : (await stopped).body);
        } catch (error) {
            results.push({ error: error.message });
        }
    }
    await client.stop();
    await new Promise((done) => process.stdout.write(JSON.stringify(results), done));
}

run().then(
    () => process.exit(0),
    (error) => {
        process.stderr.write(`${error.stack}\n`);
        process.exit(1);
    },
);
