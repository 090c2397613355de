@echo off
rem Installs trueflank from this folder, without a network: install.cmd [FOLDER]   (default: %LOCALAPPDATA%\trueflank)
rem Each version gets a folder of its own, FOLDER\trueflank.cmd starts the one installed last. Runs, site files, approvals
rem and the audit trail are never touched. To go back, run the installer of the older bundle again.
setlocal
set "here=%~dp0"
set "there=%~1"
if "%there%"=="" set "there=%LOCALAPPDATA%\trueflank"
set /p version=<"%here%VERSION"
py -3.11 -c "import venv" >nul 2>&1
if errorlevel 1 (
    echo install: this bundle needs Python 3.11 with its launcher py; install it first 1>&2
    exit /b 2
)
set "new=%there%\versions\%version%"
if exist "%new%" rmdir /s /q "%new%"
py -3.11 -m venv "%new%" || exit /b 2
"%new%\Scripts\python" -m pip install --quiet --disable-pip-version-check --no-index --no-cache-dir --find-links "%here%wheels" --require-hashes -r "%here%requirements.lock"
if errorlevel 1 (
    echo install: a file of the bundle is not as it was made; %there%\trueflank.cmd still starts the version of before 1>&2
    exit /b 2
)
>"%there%\trueflank.cmd" echo @"%new%\Scripts\python" -m gateway.cli %%*
echo trueflank %version% is installed. Start it: "%there%\trueflank.cmd" --help
