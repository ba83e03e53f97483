// Something that tells what is: events with a name and a detail.
export class Teller extends EventTarget {
  tell(name, detail = null) { this.dispatchEvent(new CustomEvent(name, { detail })); }

  on(name, heard) { this.addEventListener(name, (event) => heard(event.detail)); }
}
