// Search on pages that are opened as files. Browsers do not start workers from files, so the worker's script runs
// in a hidden frame, and messages are handed over as events. Served pages use real workers.
if (location.protocol === "file:") {
    window.Worker = class extends EventTarget {
        constructor(url) {
            super()
            this.frame = document.createElement("iframe")
            this.frame.hidden = true
            document.body.append(this.frame)
            const inner = this.frame.contentWindow
            inner.postMessage = data => this.dispatchEvent(new MessageEvent("message", {data}))
            inner.importScripts = (...scripts) => Promise.all(scripts.map(script => this.load(script)))
            this.ready = this.load(url)
        }

        load(url) {
            const script = this.frame.contentDocument.createElement("script")
            script.src = url
            this.frame.contentDocument.body.append(script)
            return new Promise(loaded => { script.onload = loaded })
        }

        postMessage(data) {
            this.ready.then(() => this.frame.contentWindow.dispatchEvent(new MessageEvent("message", {data})))
        }

        terminate() {
            this.frame.remove()
        }
    }
}
