// Draws the document of this service. Calls go where the page came from, under whatever prefix a proxy puts before it.
const answer = await fetch("openapi.json");
const spec = await answer.json();
spec.servers = [{ url: new URL(".", document.baseURI).href.replace(/\/$/, "") }];
SwaggerUIBundle({ spec, dom_id: "#api", deepLinking: true, validatorUrl: null, persistAuthorization: false });
