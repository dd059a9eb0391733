// A view whose code is fetched when it is first shown: the list of maps comes without the 3D library.

import type { ComponentType } from "preact";
import { ErrorText } from "./ErrorText";
import { useLoaded } from "./useLoaded";

export function later<P extends object>(load: () => Promise<ComponentType<P>>): ComponentType<P> {
  return function Later(props: P) {
    const loaded = useLoaded(load, []);
    const View = loaded.value;
    if (loaded.error) return <Missing />;
    return View ? <View {...props} /> : <p role="status">Opening …</p>;
  };
}

// The files of a release are gone when the service runs another. A browser remembers that a module was missing.
function Missing() {
  const error = new Error("This part of the page could not be loaded. The service may have been updated: load the page anew.");
  return <ErrorText error={error} again={() => location.reload()} />;
}
