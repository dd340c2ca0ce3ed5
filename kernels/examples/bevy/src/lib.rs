//! `app.add_plugins(RaytwinPlugin)` makes every kernel importable from WESL:
//!
//! ```wgsl
//! import raytwin::sample::cone::cone_sample;
//! ```

use bevy_app::{App, Plugin};
use bevy_asset::{Assets, Handle};
use bevy_ecs::resource::Resource;
use bevy_shader::Shader;
use raytwin::wgsl::MODULES;

/// Adds all modules to the app's shaders. Add it after the plugin that brings
/// `Assets<Shader>` (with `DefaultPlugins`: after those).
pub struct RaytwinPlugin;

/// Keeps the modules alive: an asset without a handle is dropped.
#[derive(Resource)]
#[expect(dead_code, reason = "held, not read")]
struct RaytwinShaders(Vec<Handle<Shader>>);

impl Plugin for RaytwinPlugin {
    fn build(&self, app: &mut App) {
        let mut shaders = app.world_mut().resource_mut::<Assets<Shader>>();
        let handles = MODULES.iter().map(|module| {
            // Bevy makes `raytwin::sample::cone` of this path.
            let path = format!("embedded://raytwin/{}.wesl", module.name);
            shaders.add(Shader::from_wesl(module.wesl(), path))
        });
        let handles = RaytwinShaders(handles.collect());
        app.insert_resource(handles);
    }
}

#[cfg(test)]
#[path = "../../../../tests/tests/packaging/calls.rs"]
mod calls;

#[cfg(test)]
mod tests {
    use super::*;
    use bevy_asset::{AssetApp, AssetPlugin};
    use bevy_shader::{ShaderCache, ShaderCacheSource};
    use naga::valid::{Capabilities, ValidationFlags, Validator};

    fn app() -> App {
        let mut app = App::new();
        app.add_plugins(AssetPlugin::default());
        app.init_asset::<Shader>();
        app.add_plugins(RaytwinPlugin);
        app
    }

    #[test]
    fn every_module_is_imported_by_a_shader_of_the_app() {
        let mut app = app();
        let mut shaders = app.world_mut().resource_mut::<Assets<Shader>>();
        let mut roots = Vec::new();
        for module in MODULES {
            let (main, imports) = calls::calls(module);
            let head = imports
                .iter()
                .map(|(path, names)| format!("import {path}::{{{}}};\n", names.join(", ")));
            let source = head.collect::<String>() + &main;
            let path = format!("shaders/{}.wesl", module.name);
            let handle = shaders.add(Shader::from_wesl(source, path));
            roots.push((module.name, handle));
        }
        let mut cache = ShaderCache::<String, ()>::new((), |_, source, _| match source {
            ShaderCacheSource::Wgsl(text) => Ok(text),
            _ => panic!("Bevy gives WGSL"),
        });
        for (id, shader) in shaders.iter() {
            cache.set_shader(id, shader.clone());
        }
        assert_eq!(roots.len(), MODULES.len());
        for (i, (name, root)) in roots.iter().enumerate() {
            let text = cache.get(i, root.id(), &[]);
            let text = text.unwrap_or_else(|e| panic!("{name}: {e}"));
            let module = naga::front::wgsl::parse_str(&text);
            let module = module.unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(&text)));
            let valid = Validator::new(ValidationFlags::all(), Capabilities::empty());
            let valid = { valid }.validate(&module);
            valid.unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(&text)));
            assert_eq!(module.entry_points.len(), 1, "{name}");
        }
    }
}
